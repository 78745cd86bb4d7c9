"""Sample-and-hold: the firmware may convert a sample again with another range."""

from __future__ import annotations

from array import array
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from eskin_sensor_node.firmware.autoranging import Readings

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from eskin.interval import Floats
    from eskin_sensor_node.firmware.control_unit import ControlUnit
    from eskin_sensor_node.kinds.converter import Codes
    from eskin_sensor_node.kinds.frontend import Digitised
    from eskin_sensor_node.node.signal_chain import SignalChain


class Repeats(NamedTuple):
    """Samples that were converted again.

    Attributes:
        samples: How many.
        conversions: How often in all.
    """

    samples: int = 0
    conversions: int = 0


class SampleHold:
    """The held samples of one input, of one frame.

    Args:
        values: What is held before the amplifier.
        signal_chain: Converts it.

    Attributes:
        conversions: How often something was converted again.
    """

    def __init__(self, values: Floats, signal_chain: SignalChain) -> None:
        self._values = values
        self._signal_chain = signal_chain
        self._known: dict[tuple[float, int], Codes] = {}
        self.conversions = 0

    def sample(self, k: int) -> Callable[[float, int], int]:
        """Converts the k-th sample again, with a gain and a step of the trimmer."""

        def convert(gain: float, trim: int) -> int:
            self.conversions += 1
            if (gain, trim) not in self._known:
                self._known[gain, trim] = self._signal_chain.frontend.repeat(
                    self._values, gain, trim
                )
            return int(self._known[gain, trim][k])

        return convert


class Reader:
    """Reads the inputs of one taxel.

    Args:
        unit: Its control unit.
        signal_chain: What is before it.
        inputs: Names of the inputs, in their order.

    Attributes:
        repeats: What was converted again since it began.
    """

    def __init__(self, unit: ControlUnit, signal_chain: SignalChain, inputs: Sequence[str]) -> None:
        self._unit = unit
        self._signal_chain = signal_chain
        self._inputs = inputs
        self.begin()

    def begin(self) -> None:
        """Reset the count."""
        self.repeats = Repeats()

    def read(self, digitised: Digitised) -> Readings:
        """The codes of each input, after the firmware has repeated what it wanted."""
        codes = [array("q", digitised.codes[name].tobytes()) for name in self._inputs]
        if not self._unit.adaptive:
            return Readings(codes, ())
        amplified = [name for name in self._inputs if name in digitised.held]
        readings = Readings(codes, [array("b", bytes(len(codes[0]))) for _ in amplified])
        for i, name in enumerate(amplified):
            self._repeat(readings, i, SampleHold(digitised.held[name], self._signal_chain))
        return readings

    def _repeat(self, readings: Readings, i: int, held: SampleHold) -> None:
        codes = np.asarray(readings.codes[i])
        for k in np.flatnonzero((codes <= 0) | (codes >= self._signal_chain.last)).tolist():
            self._unit.repeat(readings, i, k, held.sample(k))
        samples = sum(mark != 0 for mark in readings.ranges[i])
        self.repeats = Repeats(
            self.repeats.samples + samples, self.repeats.conversions + held.conversions
        )
