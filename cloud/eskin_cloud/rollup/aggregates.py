"""Aggregates of runs of samples: hulls, sums, counts and times."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Final, TypeAlias

import numpy as np

from eskin.kernels.jit import kernel, part
from eskin.kernels.outward_rounding import greater, lesser
from eskin.kernels.summation import sum_up

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from eskin.interval import Floats

Integers: TypeAlias = "NDArray[np.int64]"

# Rows of the output, in the order of the attributes of `Aggregates`.
_FIRST, _LAST, _N, _BREAKS, _DT, _ERROR = range(6)
_LO, _HI, _SUM_LO, _SUM_HI, _COVERAGE = range(5)
_WHOLE: Final = 6
"""Number of integer columns; the others are floats."""


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


@dataclass(frozen=True, slots=True)
class Aggregates:
    """Aggregates in order of time, an array entry each.

    Attributes:
        first: Time of the first sample, UTC ns.
        last: Time of the last sample.
        n: Number of samples.
        breaks: Number of gaps between them.
        dt: Period of the last sample, ns.
        error: The greatest time error, in ns.
        lo: Least lower bound.
        hi: Greatest upper bound.
        sum_lo: A lower bound of the sum of lower bounds.
        sum_hi: An upper bound of the sum of upper bounds.
        coverage: The least coverage.
    """

    first: Integers
    last: Integers
    n: Integers
    breaks: Integers
    dt: Integers
    error: Integers
    lo: Floats
    hi: Floats
    sum_lo: Floats
    sum_hi: Floats
    coverage: Floats

    def __len__(self) -> int:
        return self.first.size

    def __getitem__(self, chosen: NDArray[np.bool_] | NDArray[np.intp] | slice) -> Aggregates:
        """A selection."""
        return Aggregates(*(getattr(self, name)[chosen] for name in _NAMES))

    def grouped(self, key: Integers) -> Aggregates:
        """Aggregate each run of entries with the same key.

        Args:
            key: Sorted keys.
        """
        if len(self) == 0:
            return self
        columns = [getattr(self, name) for name in _NAMES]
        whole, real = np.empty((_WHOLE, len(self)), np.int64), np.empty((_REAL, len(self)))
        n = fold_pieces(key, tuple(columns[:_WHOLE]), tuple(columns[_WHOLE:]), (whole, real))
        return Aggregates(*whole[:, :n], *real[:, :n])

    @classmethod
    def of_samples(
        cls,
        bounds: tuple[Floats, Floats],
        runs: Integers,
        coverage: Floats,
        grid: tuple[int, int],
        most: int,
    ) -> Aggregates:
        """Aggregate samples by the buckets of a grid.

        Args:
            bounds: Bounds of the samples.
            runs: Consecutive runs, see `fold_samples`.
            coverage: Coverage of each run.
            grid: Start of a bucket, and the width of all, in ns.
            most: Most buckets.
        """
        room = min(most, bounds[0].size)
        whole, real = np.empty((_WHOLE, room), np.int64), np.empty((_REAL, room))
        n = fold_samples(bounds, runs, coverage, grid, (whole, real))
        return cls(*whole[:, :n], *real[:, :n])


def longest_step(dt: Integers) -> Integers:
    """The longest step to the next sample without a gap: 1.5 periods."""
    return dt + dt // 2


def concatenated(parts: Sequence[Aggregates]) -> Aggregates:
    """Concatenate, in order of time."""
    parts = [part for part in parts if len(part)]
    if not parts:
        return EMPTY
    if len(parts) == 1:
        return parts[0]
    joined = Aggregates(*(np.concatenate([getattr(p, name) for p in parts]) for name in _NAMES))
    return joined[np.argsort(joined.first, kind="stable")]


_NAMES: Final = tuple(field.name for field in fields(Aggregates))

_REAL: Final = len(_NAMES) - _WHOLE

_NOTHING: Final = np.empty((len(_NAMES), 0), np.int64)

EMPTY: Final = Aggregates(*_NOTHING[:_WHOLE], *_NOTHING[_WHOLE:].view(np.float64))
