"""A recording: what each of its channels was, and where nothing is known of it."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np

from eskin.errors import RecordingError
from eskin.interval import Interval
from eskin.wire.timestamp import SECOND
from eskin_sensor_node.world.replay.rows import read_rows

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from eskin_sensor_node.world.replay.rows import Row

_GAP: Final = 1.5
"""Two samples further apart than so many periods have a gap between them."""


@dataclass(frozen=True, slots=True)
class RecordedSeries:
    """One channel.

    Attributes:
        times: In ns since the recording's first sample, rising.
        values: What was recorded then; thin where it is a plain value.
        period: The median distance of two samples, in ns; 0 for a single one.
        gaps: Where samples are missing: the times of the last one before and the first one after.
    """

    times: NDArray[np.int64]
    values: Interval
    period: int
    gaps: tuple[tuple[int, int], ...]

    def nearest(self, ticks: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
        """The samples nearest to some times, and which times have none within half a period."""
        after = np.clip(np.searchsorted(self.times, ticks), 1, max(1, len(self.times) - 1))
        before = after - 1
        after = np.minimum(after, len(self.times) - 1)
        later = ticks - self.times[before] > self.times[after] - ticks
        chosen = np.where(later, after, before)
        missing = np.abs(ticks - self.times[chosen]) * 2 > self.period
        return chosen, missing


@dataclass(frozen=True, slots=True)
class Recording:
    """All channels of a file.

    Attributes:
        file: Where it was read.
        series: Channel to what was recorded.
        errors: What is wrong with it, each with file, place and reason: gaps, and what ended
            the reading early. What stood before is in the series.
    """

    file: Path
    series: dict[str, RecordedSeries]
    errors: tuple[RecordingError, ...]

    def channel(self, name: str) -> RecordedSeries:
        """One channel.

        Raises:
            RecordingError: It is not there.
        """
        if name not in self.series:
            known = ", ".join(self.series)[:200]
            raise RecordingError(self.file, "channel", f"{name!r} is not in it; it has {known}")
        return self.series[name]


def read_recording(path: Path | str) -> Recording:
    """Read as much of a recording as can be trusted.

    Raises:
        RecordingError: Not even its first sample can be.
    """
    file = Path(path)
    tracks: dict[str, _Track] = {}
    end: list[RecordingError] = []
    try:
        for row in read_rows(file):
            tracks.setdefault(row.channel, _Track()).add(file, row)
    except RecordingError as error:
        if not any(track.times for track in tracks.values()):
            raise
        end.append(error)
    if not tracks:
        raise RecordingError(file, "file", "it has a header, and no sample")
    start = min(track.times[0] for track in tracks.values())
    series = {name: track.series(start) for name, track in tracks.items()}
    gaps = [gap for name, track in tracks.items() for gap in track.gaps(file, name)]
    return Recording(file, series, (*gaps, *end))


@dataclass(slots=True)
class _Track:
    """A channel while it is read."""

    times: list[int] = field(default_factory=list)
    lo: list[float] = field(default_factory=list)
    hi: list[float] = field(default_factory=list)
    places: list[str] = field(default_factory=list)

    def add(self, file: Path, row: Row) -> None:
        """Take the next row; refuse one that does not come after the last."""
        if self.times and row.time <= self.times[-1]:
            what = "stands twice" if row.time == self.times[-1] else "runs backwards"
            reason = f"time {row.time / SECOND:.9g} s of {row.channel} {what}"
            raise RecordingError(file, row.place, reason)
        self.times.append(row.time)
        self.lo.append(row.lo)
        self.hi.append(row.hi)
        self.places.append(row.place)

    @property
    def period(self) -> int:
        """Median distance of two samples, in ns."""
        return int(np.median(np.diff(self.times))) if len(self.times) > 1 else 0

    def series(self, start: int) -> RecordedSeries:
        """What was read, with times since a start."""
        times = np.array(self.times, dtype=np.int64) - start
        gaps = tuple((int(times[k]), int(times[k + 1])) for k in self._broken())
        return RecordedSeries(
            times, Interval(np.array(self.lo), np.array(self.hi)), self.period, gaps
        )

    def gaps(self, file: Path, name: str) -> Iterator[RecordingError]:
        """A line about each gap."""
        for k in self._broken():
            lost = (self.times[k + 1] - self.times[k]) / SECOND
            reason = f"gap of {lost:.6g} s in {name} before this; it is kept as a gap"
            yield RecordingError(file, self.places[k + 1], reason)

    def _broken(self) -> list[int]:
        found: list[int] = np.flatnonzero(np.diff(self.times) > _GAP * self.period).tolist()
        return found
