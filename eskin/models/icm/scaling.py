"""From the response to volts or amperes: times an interval amplitude, rounded outward."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from eskin.kernels.intrinsics import fma
from eskin.kernels.jit import part
from eskin.models.icm.response import ROUNDING, UNDERFLOW

if TYPE_CHECKING:
    from eskin.models.icm.bracket import Found
    from eskin.models.parameters import Floats

_STEP: Final = 1.0001 * 2.0**-53  # of a float: enough to round to its neighbour
_LEAST: Final = 5e-324
_BEYOND: Final = 3.5  # slopes are within 3·ROUNDING·T: as much, with margin, for each unit of ln τ


@part
def error_factor(width: float) -> float:
    """Error of a range of ``h``, relative to ``T``, where ``ln τ`` covers ``width``.

    The ends carry the error of ``h``. Between them the slope is known to keep its sign only within
    its own error, which may add up over the width.
    """
    return ROUNDING * (1.0 + _BEYOND * width)


@part
def scale_outward(inf: float, sup: float, factor: float, times: Floats, found: Found) -> None:
    """Turn ranges of computed values into enclosures, times the amplitude ``[inf, sup]``.

    Args:
        inf: Least amplitude.
        sup: Greatest amplitude.
        factor: Of `error_factor`.
        times: Times; until 0 all is exactly zero.
        found: Least and greatest computed values, which become the bounds; and sums of sizes.
    """
    lo, hi, size = found
    for i in range(lo.size):
        error = fma(factor, size[i], UNDERFLOW)
        silent = times[i] <= 0.0
        below = lo[i] - error
        above = hi[i] + error
        least = min(min(inf * below, sup * below), min(inf * above, sup * above))
        most = max(max(inf * below, sup * below), max(inf * above, sup * above))
        lo[i] = 0.0 if silent else fma(-_STEP, abs(least), least) - _LEAST
        hi[i] = 0.0 if silent else fma(_STEP, abs(most), most) + _LEAST
