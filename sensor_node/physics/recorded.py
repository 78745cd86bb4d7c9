"""A recording in the place of physics."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING, Final

import numpy as np

from eskin.interval import Interval
from sensor_node.machine.crystal import BILLION
from sensor_node.physics.signals import Signals
from sensor_node.replay import read_recording

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from eskin.interval import Floats
    from sensor_node.replay import Recorded

log = logging.getLogger(__name__)

_OPEN_LINE: Final = {"capacitance": 1e-18, "inductance": 1e6}
"""What the oscillator has, in F or H, where nothing was recorded: its converter saturates."""


class RecordedWorld:
    """One channel of a recording, from the node's start on.

    A sample is taken from the recorded one that is nearest, within half of the recording's period.
    Of a recorded interval the world is drawn that it had: a value from inside.

    Args:
        taxel: Where the recording is.
        quantity: What it is of: ``capacitance`` or ``inductance``.
        random: Draws from inside of recorded intervals.

    Raises:
        RecordingError: The recording, or the channel in it, cannot be read.
    """

    def __init__(self, taxel: Recorded, quantity: str, random: np.random.Generator) -> None:
        recording = read_recording(taxel.recording)
        self._series = recording.channel(taxel.channel)
        for complaint in recording.complaints:
            log.warning("recording is not whole: %s", complaint)
        self._quantity = quantity
        values = self._series.values * Interval(taxel.scale)
        share = random.random(len(self._series.times))
        lo, hi = values.inf, values.sup
        self._unbounded = ~values.is_common_interval
        with np.errstate(invalid="ignore"):
            self._values = np.clip(lo + share * (hi - lo), lo, hi)

    def missing(self, seconds: Floats) -> NDArray[np.bool_]:
        """At which times nothing was recorded, or something unbounded."""
        chosen, missing = self._series.nearest(_ticks(seconds))
        return np.asarray(missing | self._unbounded[chosen])

    def signals(self, seconds: Floats, random: np.random.Generator) -> Signals:
        """The recorded quantity; an open line where nothing was recorded."""
        del random
        chosen, _ = self._series.nearest(_ticks(seconds))
        value = np.where(self.missing(seconds), _OPEN_LINE[self._quantity], self._values[chosen])
        truth = {self._quantity: value}
        return Signals(truth, truth)


def _ticks(seconds: Floats) -> NDArray[np.int64]:
    return np.rint(seconds * BILLION).astype(np.int64)
