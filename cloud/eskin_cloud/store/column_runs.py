"""Samples of one channel that were taken one after the other."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.typing import NDArray

    from eskin.interval import Floats

    Integers = NDArray[np.int64]


class ColumnRun(NamedTuple):
    """Samples of a channel that were taken one after the other, from one frame.

    Attributes:
        t: Middle of the first sample's time, UTC ns.
        boot: The node's start.
        sequence: The frame's number.
        dt: Sampling period, ns.
        error: Greatest distance of a sample's time from its middle, ns.
        coverage: Probability that a sample's interval encloses the truth.
        lo: Lower bounds.
        hi: Upper bounds.
    """

    t: int
    boot: int
    sequence: int
    dt: int
    error: int
    coverage: float
    lo: Floats
    hi: Floats


@dataclass(frozen=True, slots=True, eq=False)
class ColumnRuns:
    """Many `ColumnRun` in arrays: a compacted row has thousands.

    Attributes:
        t: As in `ColumnRun`, an entry a run; so are the next five.
        boot: See there.
        sequence: See there.
        dt: See there.
        error: See there.
        coverage: See there.
        n: Number of samples of each run, at least 1.
        lo: Lower bounds of all samples, run after run.
        hi: Upper bounds.
    """

    t: Integers
    boot: Integers
    sequence: Integers
    dt: Integers
    error: Integers
    coverage: Floats
    n: Integers
    lo: Floats
    hi: Floats

    @classmethod
    def of(cls, runs: Sequence[ColumnRun]) -> ColumnRuns:
        """Runs one by one, as arrays."""
        whole = np.array([run[:5] for run in runs], np.int64).reshape(-1, 5).T
        nothing = [np.empty(0)]
        return cls(
            whole[0],
            whole[1],
            whole[2],
            whole[3],
            whole[4],
            coverage=np.array([run.coverage for run in runs], np.float64),
            n=np.array([run.lo.size for run in runs], np.int64),
            lo=np.concatenate(nothing + [run.lo for run in runs]),
            hi=np.concatenate(nothing + [run.hi for run in runs]),
        )

    @classmethod
    def joined(cls, parts: Sequence[ColumnRuns]) -> ColumnRuns:
        """The runs of some, one after the other."""
        if len(parts) == 1:
            return parts[0]
        return cls(*(np.concatenate([getattr(p, name) for p in parts]) for name in _NAMES))

    def __len__(self) -> int:
        return self.t.size

    def __iter__(self) -> Iterator[ColumnRun]:
        ends = np.cumsum(self.n)
        places = zip((ends - self.n).tolist(), ends.tolist(), strict=True)
        whole = (self.t, self.boot, self.sequence, self.dt, self.error)
        heads = zip(*(each.tolist() for each in whole), strict=True)
        coverages = self.coverage.tolist()
        for (t, boot, sequence, dt, error), coverage, (begin, end) in zip(
            heads, coverages, places, strict=True
        ):
            lo, hi = self.lo[begin:end], self.hi[begin:end]
            yield ColumnRun(t, boot, sequence, dt, error, coverage, lo, hi)

    def chosen(self, which: NDArray[np.intp]) -> ColumnRuns:
        """Some of the runs, in an order."""
        if np.array_equal(which, np.arange(len(self))):
            return self
        n = self.n[which]
        begins = (np.cumsum(self.n) - self.n)[which]
        cells = np.repeat(begins - (np.cumsum(n) - n), n) + np.arange(n.sum())
        heads = (getattr(self, name)[which] for name in _NAMES[:-2])
        return ColumnRuns(*(*heads, self.lo[cells], self.hi[cells]))

    def sorted(self) -> ColumnRuns:
        """The runs in order of time, boot and sequence."""
        return self.chosen(np.lexsort((self.sequence, self.boot, self.t)))

    def clipped(self, start: int, end: int) -> tuple[Integers, Integers]:
        """The first and the last index of each run's samples in a window; last < first if none.

        Args:
            start: UTC ns, included.
            end: UTC ns, excluded.
        """
        t, dt, final = self.t, self.dt, self.t + self.dt * (self.n - 1)
        # A run overlaps the window or lies just beside it, so no difference exceeds 64 bits.
        first = -((np.minimum(t, start) - start) // dt)
        last = (np.minimum(final, end - 1) - np.minimum(t, end)) // dt
        return first, np.where(t < end, last, -1)


_NAMES = tuple(each.name for each in fields(ColumnRuns))
