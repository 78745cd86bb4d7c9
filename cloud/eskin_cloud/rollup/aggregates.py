"""Aggregates of runs of samples: hulls, sums, counts and times."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Final, TypeAlias

import numpy as np

from eskin_cloud.rollup.aggregate import fold_pieces, fold_samples

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from eskin.interval import Floats


Integers: TypeAlias = "NDArray[np.int64]"


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
_WHOLE: Final = 6
"""Number of integer columns; the others are floats."""
_REAL: Final = len(_NAMES) - _WHOLE
_NOTHING: Final = np.empty((len(_NAMES), 0), np.int64)
EMPTY: Final = Aggregates(*_NOTHING[:_WHOLE], *_NOTHING[_WHOLE:].view(np.float64))
