"""What peaks are sought in: tubes, intervals, or plain bounds."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeGuard

import numpy as np

from eskin.errors import IntervalError
from eskin.interval import Interval
from eskin.interval.conversion import as_compiled, enclose
from eskin.tube import Tube

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from eskin.interval import Floats


def samples_of(
    samples: Tube | Interval | ArrayLike, highs: ArrayLike | None
) -> tuple[Floats, Floats]:
    """Lower and upper bounds, contiguous, of one axis.

    Raises:
        IntervalError: They are none, or differ in number.
    """
    if _is_plain(samples) and _is_plain(highs) and samples.shape == highs.shape:
        return samples, highs
    if isinstance(samples, Tube):
        samples = samples.values
    if isinstance(samples, Interval):
        if highs is not None:
            raise IntervalError(
                "a tube or an interval has its upper bounds already; leave highs out"
            )
        lo, hi = samples.inf, samples.sup
    elif highs is None:
        raise IntervalError(
            "lower bounds need upper bounds; where a signal is exact, give it for both"
        )
    else:
        lo, hi = enclose(samples, "lows")[0], enclose(highs, "highs")[1]
    if lo.ndim != 1 or lo.shape != hi.shape:
        raise IntervalError(
            f"lows and highs need one axis and the same length, not {lo.shape} and {hi.shape}"
        )
    return as_compiled(lo), as_compiled(hi)


def _is_plain(bounds: object) -> TypeGuard[Floats]:
    """Whether these are bounds as they should be: short blocks cannot wait for all other checks."""
    return (
        type(bounds) is np.ndarray
        and bounds.dtype == np.float64
        and bounds.ndim == 1
        and bounds.flags.c_contiguous
        and bounds.flags.carray
    )
