"""From a row of compiled searches to the firmware's detector, which goes on where it stands."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from eskin.peaks.hysteresis import NONE
from sensor_node.firmware.peaks import Hysteresis, PeakDetector, Span

if TYPE_CHECKING:
    from sensor_node.fleet.telling import Search


class _StandingPass(Hysteresis):
    """A pass that others began."""

    __slots__ = ()

    def __init__(self, prominence: float, at: Any, latest: int) -> None:
        super().__init__(prominence)
        if at["first"] != NONE:
            self.span = _span(at, latest)
            self._valley, self._crest = float(at["valley"]), float(at["crest"])
            self._rising = bool(at["rising"])


class _StandingDetector(PeakDetector):
    """A search that others began."""

    def __init__(self, prominence: float, progress: Any, passes: Any, regions: Any) -> None:
        super().__init__(prominence, int(progress["longest"]))
        self._index = int(progress["index"])
        self._certain, self._optimistic = (
            _StandingPass(prominence, each, self._index - 1) for each in passes
        )
        for region in regions[: int(progress["waiting"])]:
            span = _span(region, int(region["last"]))
            span.peaks = int(region["peaks"])
            self._undecided.append(span)


def standing(searches: Search, k: int, row: int, prominence: float) -> PeakDetector | None:
    """The search of the k-th channel of one node; ``None`` where no peaks are sought."""
    if prominence <= 0.0:
        return None
    given = searches.progress[k, row], searches.passes[k, row], searches.regions[k, row]
    return _StandingDetector(prominence, *given)


def _span(given: Any, last: int) -> Span:
    span = Span(int(given["first"]), float(given["lowest"]), float(given["ceiling"]))
    span.last, span.floor = last, float(given["floor"])
    return span
