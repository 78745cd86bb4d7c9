"""Compiled kernels that aggregate samples and aggregates."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from eskin.kernels.jit import kernel, part
from eskin.kernels.outward_rounding import greater, lesser
from eskin.kernels.summation import sum_up

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from eskin.interval import Floats

    Integers: TypeAlias = NDArray[np.int64]

# Rows of the output, in the order of the attributes of `Aggregates`.
_FIRST, _LAST, _N, _BREAKS, _DT, _ERROR = range(6)
_LO, _HI, _SUM_LO, _SUM_HI, _COVERAGE = range(5)


@kernel
def fold_samples(
    bounds: tuple[Floats, Floats],
    runs: Integers,
    coverage: Floats,
    grid: tuple[int, int],
    out: tuple[Integers, Floats],
) -> int:
    """Aggregate the samples of consecutive runs, one entry for each bucket with samples.

    Args:
        bounds: Lower and upper bounds.
        runs: Of each: time of the first sample, period, number of samples, their offset in
            the bounds, and time error; shape ``(runs, 5)``.
        coverage: Of each run.
        grid: Start of a bucket, and the width of all, in ns.
        out: Output; shapes ``(6, room)`` and ``(5, room)``.

    Returns:
        The number of entries.
    """
    whole, real = out
    count, current, begin, end = 0, 0, 0, 0
    for k in range(runs.shape[0]):
        t, dt, left, place, error = runs[k]
        while left > 0:
            bucket, behind = divmod(t - grid[0], grid[1])
            size = min(left, (grid[1] - behind + dt - 1) // dt)
            if count == 0 or bucket != current:
                if count:
                    _sum(bounds, begin, end, real[:, count - 1])
                _open(whole[:, count], real[:, count], t)
                count, current, begin = count + 1, bucket, place
            else:
                _link(whole[:, count - 1], t - whole[_LAST, count - 1])
            end = place + size
            last = t + (size - 1) * dt
            _add(whole[:, count - 1], last, size, dt, error)
            _hull(bounds, place, end, real[:, count - 1])
            real[_COVERAGE, count - 1] = lesser(coverage[k], real[_COVERAGE, count - 1])
            left, place = left - size, end
            if left:
                t = last + dt
    if count:
        _sum(bounds, begin, end, real[:, count - 1])
    return count


@part
def _open(whole: Integers, real: Floats, t: int) -> None:
    """Initialise an entry without samples."""
    whole[:] = 0
    whole[_FIRST] = t
    real[_LO], real[_HI], real[_COVERAGE] = np.inf, -np.inf, np.inf


@part
def _link(whole: Integers, step: int) -> None:
    """Add the step from an entry's last sample to its next one."""
    dt = whole[_DT]
    whole[_BREAKS] += step > dt + dt // 2


@part
def _add(whole: Integers, last: int, size: int, dt: int, error: int) -> None:
    whole[_LAST] = last
    whole[_N] += size
    whole[_DT] = dt
    whole[_ERROR] = max(whole[_ERROR], error)


@part
def _hull(bounds: tuple[Floats, Floats], begin: int, end: int, real: Floats) -> None:
    lo, hi = real[_LO], real[_HI]
    for k in range(begin, end):
        lo, hi = lesser(bounds[0][k], lo), greater(bounds[1][k], hi)
    real[_LO], real[_HI] = lo, hi


@part
def _sum(bounds: tuple[Floats, Floats], begin: int, end: int, real: Floats) -> None:
    real[_SUM_LO] = -sum_up(bounds[0][begin:end], -1.0)
    real[_SUM_HI] = sum_up(bounds[1][begin:end], 1.0)


@kernel
def fold_pieces(
    key: Integers,
    whole: tuple[Integers, ...],
    real: tuple[Floats, ...],
    out: tuple[Integers, Floats],
) -> int:
    """Aggregate each run of entries with the same key.

    Args:
        key: Sorted keys.
        whole: The integer attributes, an array each.
        real: The float attributes.
        out: Output; shapes ``(6, entries)`` and ``(5, entries)``.

    Returns:
        The number of runs.
    """
    count, begin = 0, 0
    for k in range(key.size):
        if k == 0 or key[k] != key[k - 1]:
            if count:
                _sum((real[_SUM_LO], real[_SUM_HI]), begin, k, out[1][:, count - 1])
            _open(out[0][:, count], out[1][:, count], whole[_FIRST][k])
            out[0][_LAST, count] = whole[_LAST][k]
            count, begin = count + 1, k
        else:
            _link(out[0][:, count - 1], whole[_FIRST][k] - whole[_LAST][k - 1])
        _join(whole, real, k, (out[0][:, count - 1], out[1][:, count - 1]))
    if count:
        _sum((real[_SUM_LO], real[_SUM_HI]), begin, key.size, out[1][:, count - 1])
    return count


@part
def _join(
    whole: tuple[Integers, ...], real: tuple[Floats, ...], k: int, out: tuple[Integers, Floats]
) -> None:
    numbers, floats = out
    numbers[_LAST] = max(numbers[_LAST], whole[_LAST][k])
    numbers[_N] += whole[_N][k]
    numbers[_BREAKS] += whole[_BREAKS][k]
    numbers[_DT] = whole[_DT][k]
    numbers[_ERROR] = max(numbers[_ERROR], whole[_ERROR][k])
    floats[_LO] = lesser(real[_LO][k], floats[_LO])
    floats[_HI] = greater(real[_HI][k], floats[_HI])
    floats[_COVERAGE] = lesser(real[_COVERAGE][k], floats[_COVERAGE])
