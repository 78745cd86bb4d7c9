"""Tubes that follow each other without a gap become one."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from eskin.interval import Interval

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from eskin.tube import Tube


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
        more than a period than what any part knew, a tube of its own tells more.
        """
        last = self._parts[-1]
        if (tube.dt, tube.unit, tube.coverage) != (last.dt, last.unit, last.coverage):
            return False
        if abs(tube.first_moment - last.first_moment - len(last) * last.dt) > last.dt // 2:
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
