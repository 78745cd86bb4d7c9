"""Adaptive control within a frame: a sample whose code is at an end is converted again at once.

A sample-and-hold before the amplifier keeps what was sampled, so that each conversion of a sample
reads the same value, only with another range: the least gain, and the trimmer where it takes the
range on beyond the end. A frame's own setting stays what it is until the next frame.
"""

from array import array

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Callable, MutableSequence, Sequence

    from eskin_sensor_node.firmware.adaptation import Adaptation
    from eskin_sensor_node.firmware.inversion import Buffer
    from eskin_sensor_node.firmware.taxel.taxel import Taxel

    Hold = Callable[[float, int], int]
    """Converts what is held once more, with a gain and a step of the trimmer; gives the code."""

MOST = 3
"""Times that a sample is converted again at most."""


class Readings:
    """A frame's codes, and the ranges that they were converted with.

    Attributes:
        codes: Of each input, one a sample.
        ranges: Of each amplified input, one a sample: 0 for the frame's own; k or -k for the k-th
            beyond its upper or its lower end.
    """

    __slots__ = ("codes", "ranges")

    def __init__(
        self, codes: "Sequence[MutableSequence[int]]", ranges: "Sequence[MutableSequence[int]]"
    ) -> None:
        self.codes = codes
        self.ranges = ranges


class Autoranging:
    """Converts samples of one taxel again, and measures them with the range that they were given.

    Args:
        taxel: Its calibration.
        adaptation: Chooses the ranges.
        repeats: How often a sample can be converted again before the next one comes.
    """

    def __init__(self, taxel: "Taxel", adaptation: "Adaptation", repeats: int) -> None:
        self._taxel = taxel
        self._adaptation = adaptation
        self._repeats = repeats
        self._last = (1 << int(taxel.sheet["adc_bits"])) - 1
        self._setting = 0.0, 0
        self._beyond: dict[int, list[tuple[float, int]]] = {}

    def repeat(self, readings: Readings, i: int, k: int, hold: "Hold") -> None:
        """Convert the k-th sample of the i-th input again, whose code is at an end.

        What comes in its place is a code that is no end, or that of the last range there is.
        """
        codes, ranges = readings.codes[i], readings.ranges[i]
        end = codes[k]
        side = 1 if end > 0 else -1
        for number, (gain, trim) in enumerate(self._ranges(side), 1):
            codes[k] = hold(gain, trim)
            ranges[k] = side * number
            if codes[k] != end:
                break

    def measure(self, readings: Readings, n: int, bounds: "Sequence[Buffer]") -> None:
        """Fill buffers as the taxel does, each sample with its range.

        Behind it, a code with another range than the frame's is the end that it went beyond.
        """
        self._taxel.measure(readings.codes, n, bounds)
        for i, ranges in enumerate(readings.ranges):
            for mark in sorted(set(ranges[:n])):
                if mark != 0:
                    samples = [k for k in range(n) if ranges[k] == mark]
                    self._measure_again(readings, i, mark, samples, bounds)

    def _measure_again(
        self,
        readings: Readings,
        i: int,
        mark: int,
        samples: "Sequence[int]",
        bounds: "Sequence[Buffer]",
    ) -> None:
        gain, trim = self._ranges(1 if mark > 0 else -1)[abs(mark) - 1]
        self._taxel.adjust(gain, trim)
        n = len(samples)
        # Slices, for codes of the same width.
        codes = [each[:n] for each in readings.codes]
        for given, each in zip(codes, readings.codes):  # noqa: B905 - MicroPython's zip
            for j in range(n):
                given[j] = each[samples[j]]
        found = [array("d", bytes(8 * n)) for _ in bounds]
        self._taxel.measure(codes, n, found)
        self._taxel.adjust(self._adaptation.gain, self._adaptation.trim)
        for j in self._followed(i, len(bounds)):
            for k in range(n):
                bounds[j][samples[k]] = found[j][k]
        for k in samples:
            readings.codes[i][k] = self._last if mark > 0 else 0

    def _followed(self, i: int, n: int) -> "range":
        """Numbers of the bounds that follow from an input: its quantity's, or all behind one."""
        return range(n) if self._taxel.amplified == 1 else range(2 * i, 2 * i + 2)

    def _ranges(self, side: int) -> "list[tuple[float, int]]":
        """Gain and trimmer of the ranges beyond an end of the frame's, one beyond the other."""
        setting = self._adaptation.gain, self._adaptation.trim
        if setting != self._setting:
            self._setting = setting
            self._beyond = {}
        if side not in self._beyond:
            found: list[tuple[float, int]] = []
            beyond = self._adaptation.beyond(side, setting)
            while beyond is not None and len(found) < self._repeats:
                found.append(beyond)
                beyond = self._adaptation.beyond(side, beyond)
            self._beyond[side] = found
        return self._beyond[side]
