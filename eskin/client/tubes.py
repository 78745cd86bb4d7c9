"""Tubes from the rows of an export, and tubes without gaps between them joined."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa

from eskin.interval import Interval
from eskin.tube import Tube

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator


def read_tubes(table: Any) -> Iterator[Tube]:
    """A tube for each frame of one channel.

    Args:
        table: An export's Arrow table; see docs/rest.md.
    """
    if table.num_rows == 0:
        return
    boot, sequence, dt, earliest, latest = (
        table[name].cast(pa.int64()).to_numpy()
        for name in ("boot", "sequence", "dt", "earliest", "latest")
    )
    # A missing sample is unbounded on both sides (decision 12).
    lo = table["lo"].fill_null(-np.inf).to_numpy()
    hi = table["hi"].fill_null(np.inf).to_numpy()
    coverage = table["coverage"].to_numpy()
    begins = np.flatnonzero((np.diff(boot) != 0) | (np.diff(sequence) != 0)) + 1
    edges = [0, *begins.tolist(), table.num_rows]
    for first, end in pairwise(edges):
        yield Tube(
            (int(earliest[first]), int(latest[first])),
            int(dt[first]),
            Interval(lo[first:end], hi[first:end]),
            table["unit"][first].as_py(),
            float(coverage[first]),
        )


def joined(tubes: Iterable[Tube]) -> Iterator[Tube]:
    """Join each tube with those that continue it; all in order of time."""
    run: _Run | None = None
    for tube in tubes:
        if run is None or not run.take(tube):
            if run is not None:
                yield run.tube()
            run = _Run(tube)
    if run is not None:
        yield run.tube()


class _Run:
    """Tubes that are one tube in truth."""

    def __init__(self, first: Tube) -> None:
        self._parts = [first]
        self._count = len(first)
        self._time = first.time
        self._widest = first.time[1] - first.time[0]

    def take(self, tube: Tube) -> bool:
        """Add a tube; ``False`` where it does not continue the last one.

        It continues it if it has the same period, unit and coverage, and begins a period later,
        half a period more or less. The clock may have been set meanwhile: then both know the run's
        time differently, and the hull of both encloses it as surely. Where that hull is wider by
        more than a period than what any part knew, a tube of its own is narrower.
        """
        last = self._parts[-1]
        if (tube.dt, tube.unit, tube.coverage) != (last.dt, last.unit, last.coverage):
            return False
        if abs(tube.first_instant - last.first_instant - len(last) * last.dt) > last.dt // 2:
            return False
        behind = self._count * tube.dt
        time = min(self._time[0], tube.time[0] - behind), max(self._time[1], tube.time[1] - behind)
        widest = max(self._widest, tube.time[1] - tube.time[0])
        if time[1] - time[0] > widest + tube.dt:
            return False
        self._parts.append(tube)
        self._count += len(tube)
        self._time, self._widest = time, widest
        return True

    def tube(self) -> Tube:
        """All of it."""
        inf = np.concatenate([part.values.inf for part in self._parts])
        sup = np.concatenate([part.values.sup for part in self._parts])
        return replace(self._parts[0], time=self._time, values=Interval(inf, sup))
