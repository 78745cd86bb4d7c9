"""The firmware's search for peaks, in the words of eskin's: what the kernel is held to."""

from __future__ import annotations

from typing import TYPE_CHECKING

from eskin_sensor_node.firmware import peaks

from eskin.interval import Verdict
from eskin.peaks import PeakEvent

if TYPE_CHECKING:
    from collections.abc import Sequence


class Detector:
    """`eskin_sensor_node.firmware.peaks.PeakDetector`, with events as eskin has them."""

    def __init__(self, prominence: float, *, longest_region: int | None = None) -> None:
        longest = 2**62 if longest_region is None else longest_region
        self._detector = peaks.PeakDetector(prominence, longest)

    def feed(self, lows: Sequence[float], highs: Sequence[float]) -> list[PeakEvent]:
        return _events(self._detector.feed(lows, highs, len(lows)))

    def gap(self, samples: int = 0) -> list[PeakEvent]:
        return _events(self._detector.gap(samples))

    def finish(self) -> list[PeakEvent]:
        return self.gap()


def _events(found: list[peaks.PeakEvent]) -> list[PeakEvent]:
    return [
        PeakEvent(
            Verdict(event.verdict),
            event.first,
            event.last,
            event.count,
            event.height,
            event.prominence,
        )
        for event in found
    ]
