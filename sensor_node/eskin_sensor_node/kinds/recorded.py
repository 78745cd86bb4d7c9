"""A recording in the place of physics."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING, ClassVar, Final

import numpy as np

from eskin.interval import Interval
from eskin_sensor_node.kinds.signals import Signals, World
from eskin_sensor_node.timebase import BILLION
from eskin_sensor_node.world.replay import read_recording

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from eskin.interval import Floats
    from eskin_sensor_node.kinds.generator import ColumnGenerator
    from eskin_sensor_node.world.replay import Recorded

log = logging.getLogger(__name__)

_LEAST: Final = 1e-18
_MOST: Final = 1e6
"""In F or H: what the oscillator has for an unbounded side, so that its converter saturates."""


class RecordedWorld(World):
    """One channel of a recording, from the start of a node on, whose taxels the columns are.

    A sample is taken from the recorded one that is nearest, within half of the recording's period;
    elsewhere it is missing. Of a recorded interval the world is drawn that it had, a value from
    inside, and both ends are sensed: what is measured encloses the whole of it.

    Args:
        taxel: Where the recording is.
        random: Draws from inside of recorded intervals.

    Raises:
        RecordingError: The recording, or the channel in it, cannot be read.
    """

    quantity: ClassVar[str]
    """What is recorded, as the front end senses it."""

    def __init__(self, taxel: Recorded, random: ColumnGenerator) -> None:
        recording = read_recording(taxel.recording)
        self._series = recording.channel(taxel.channel)
        for error in recording.errors:
            log.warning("recording is not whole: %s", error)
        recorded = self._series.values
        self._thin = bool(np.all(recorded.inf == recorded.sup))
        values = recorded * Interval(taxel.scale)
        share = random.uniform(0.0, 1.0, len(self._series.times))[..., 0].T
        lo, hi = values.inf, values.sup
        self._unknown = np.isinf(lo) & np.isinf(hi)
        self._ends = np.clip(lo, _LEAST, _MOST), np.clip(hi, _LEAST, _MOST)
        with np.errstate(invalid="ignore"):
            inside = np.clip(lo + share * (hi - lo), lo, hi)
        # Columns × recorded times.
        self._values = np.where(np.isinf(lo), hi, np.where(np.isinf(hi), lo, inside))

    def missing(self, seconds: Floats) -> NDArray[np.bool_]:
        """At which times nothing was recorded, or something unbounded on both sides."""
        chosen, missing = self._series.nearest(_ticks(seconds))
        return np.asarray(missing | self._unknown[chosen])

    def truth(self, value: Floats) -> dict[str, Floats]:
        """What is true where the recorded quantity has some values."""
        return {self.quantity: value}

    def signals(self, seconds: Floats, random: ColumnGenerator) -> Signals:
        """The recorded quantity, the ends of its intervals, and where it is missing."""
        del random
        times = seconds.ravel()
        chosen, _ = self._series.nearest(_ticks(times))
        ends = () if self._thin else tuple({self.quantity: end[None, chosen]} for end in self._ends)
        value = self._values[:, chosen]
        return Signals(
            self.truth(value),
            {self.quantity: np.clip(value, _LEAST, _MOST)},
            ends,
            self.missing(times),
        )


def _ticks(seconds: Floats) -> NDArray[np.int64]:
    return np.rint(seconds * BILLION).astype(np.int64)
