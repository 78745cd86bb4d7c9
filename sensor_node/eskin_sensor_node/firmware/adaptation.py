"""Adaptive control G(t) of the paper: gain, trimmer and plate distance follow what is measured.

- From the stimulus (S_c): codes near an end of the converter's range, or that would come near it if
  they moved on as far as in this frame, lower the gain before the next frame; the plates move apart
  where the gain is at its least. After some frames in which more would fit, it rises again.
- From the environment (E_c): where nothing touches, the trimmer follows the drifting rest.
- Within a frame: what lies beyond an end of the range is converted again at once with the range
  that takes it on (`eskin_sensor_node.firmware.autoranging`).

A setting belongs to a frame, or to a sample that is converted again: it decides how codes are read,
never what is reported. So a contact that stays cannot be trimmed away; intervals only
become wider or narrower around it.
"""

from math import ceil, floor

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Sequence

    from eskin_sensor_node.firmware.calibration import Sheet
    from eskin_sensor_node.firmware.inversion import Codes

QUIET = 4
"""Frames in which a greater gain would have fitted, before it is taken."""
_NEAR = 1.0 / 16
"""Share of the range beside each end where the gain falls."""
_ROOM = 1.0 / 8
"""Share of the range that stays free beside each end when the gain rises."""
_STILL = 1.0 / 8
"""Share of the range within which a frame at rest stays."""
_STAY = 0.75
"""Steps of the trimmer by which the rest may be off before it is moved."""


class Adaptation:
    """Chooses the settings of the next frame.

    Args:
        sheet: The taxel's data sheet.

    Attributes:
        gain: Of the amplifier before the converter.
        trim: Steps of the trimmer behind it.
        plate: Steps by which the plates are apart.
    """

    def __init__(self, sheet: "Sheet") -> None:
        self._lowest = sheet["adc_min"]
        self._range = sheet["adc_max"] - sheet["adc_min"]
        self._codes = 1 << int(sheet["adc_bits"])
        self._gains = sheet["gain_least"], sheet["gain_most"]
        self._step = sheet["trimmer_step"] * self._range
        self._steps = int(sheet["trimmer_steps"])
        self._tolerances = sheet["gain_tolerance"], sheet["trimmer_tolerance"]
        errors = (sheet["adc_offset_error"] + sheet["adc_nonlinearity"] + 1.0) / self._codes
        self._error = 2.0 * (sheet["adc_gain_error"] + errors) * self._range
        self._plates = int(sheet.get("actuator_steps", 0.0))
        # A current of Fig. 3 grows with the distance of the plates (eq. 2, 6).
        distance = sheet.get("plate_distance", 1.0)
        self._growth = sheet.get("actuator_step", 0.0) / distance
        self.reset()

    def reset(self) -> None:
        """Go back to the design."""
        self.gain = 1.0
        self.trim = 0
        self.plate = 0
        self._quiet = 0
        self._centre = self._lowest + 0.5 * self._range

    def amplify(self, gain: float) -> None:
        """Go on from another gain, without trimming."""
        self.gain = gain
        self.trim = 0
        self._quiet = 0

    def adapt(self, codes: "Sequence[Codes]", n: int, *, rests: bool) -> None:
        """Choose the settings after a frame.

        Args:
            codes: Those of each input.
            n: How many.
            rests: Whether nothing touches, as far as is known.
        """
        least, most = extremes(codes, n)
        moved = most - least
        lo, hi = self._input(least - moved), self._input(most + 1 + moved)
        if rests and moved < _STILL * self._codes:
            self._follow(0.5 * (lo + hi))
        if self._saturates(least, most):
            self._damp_most(1 if least <= 0 else -1)
        elif not self._fits(self.gain, lo, hi, _NEAR):
            self._damp(lo, hi, least, most)
        elif self._relaxes(lo, hi):
            self._quiet += 1
            if self._quiet >= QUIET:
                self._relax()
        else:
            self._quiet = 0

    def beyond(self, side: int, setting: "tuple[float, int]") -> "tuple[float, int] | None":
        """Gain and trimmer whose range goes on where that of others ends, and reaches farthest.

        Args:
            side: 1: beyond the upper end; -1: beyond the lower one.
            setting: The others.

        Returns:
            They leave no hole between both ranges, whatever the parts truly are within their
            tolerances; ``None``: none reaches farther.
        """
        gain, trim = setting
        end = farthest = self._end(side, gain, trim)
        found = None
        while True:
            chosen = self._joined(side, gain, setting, end)
            if -self._steps <= chosen <= self._steps:
                reached = self._end(side, gain, chosen)
                if side * reached > side * farthest:
                    found, farthest = (gain, chosen), reached
            if 0.5 * gain < self._gains[0]:
                return found
            gain *= 0.5

    def _end(self, side: int, gain: float, trim: int) -> float:
        """About which input is at an end of the range."""
        top = self._range if side > 0 else 0.0
        return (self._lowest + top + trim * self._step) / gain

    def _joined(self, side: int, gain: float, setting: "tuple[float, int]", end: float) -> int:
        """The trimmer's step that has a range begin before another one ends; it may have none."""
        off = gain * end - self._lowest
        overlap = self._overlap(gain, setting, end)
        if side > 0:
            return min(self._steps, floor((off - overlap) / self._step))
        return max(-self._steps, ceil((off - self._range + overlap) / self._step))

    def _overlap(self, gain: float, setting: "tuple[float, int]", end: float) -> float:
        """How far ranges must overlap at least, for all that their true parts may be."""
        amplified = abs(gain * end)
        trimmed = abs(setting[1]) * self._step * gain / setting[0]
        trimmed += amplified + abs(self._lowest) + self._range
        return self._error + 2.0 * self._tolerances[0] * amplified + self._tolerances[1] * trimmed

    def _input(self, code: int) -> float:
        """About which input a code stands for."""
        level = self._lowest + code * self._range / self._codes
        return (level + self.trim * self._step) / self.gain

    def _follow(self, rest: float) -> None:
        off = self.gain * rest - self._lowest - 0.5 * self._range - self.trim * self._step
        if abs(off) > _STAY * self._step:
            self._centre = rest
            self.trim = self._trimmed(self.gain)

    def _trimmed(self, gain: float) -> int:
        """The trimmer's step that brings the rest nearest to the middle of the range."""
        if self._steps == 0:
            return 0
        off = gain * self._centre - self._lowest - 0.5 * self._range
        return max(-self._steps, min(self._steps, floor(off / self._step + 0.5)))

    def _fits(self, gain: float, lo: float, hi: float, margin: float) -> bool:
        trim = self.trim if gain == self.gain else self._trimmed(gain)
        offset = trim * self._step + self._lowest
        free = margin * self._range
        above = gain * lo - offset >= free or self._ends_in_nothing(offset)
        return above and gain * hi - offset <= self._range - free

    def _ends_in_nothing(self, offset: float) -> bool:
        """Whether no input can lie below the range: a current that only flows one way."""
        return self._lowest >= 0.0 and offset <= 0.0

    def _saturates(self, least: int, most: int) -> bool:
        offset = self.trim * self._step + self._lowest
        below = least <= 0 and not self._ends_in_nothing(offset)
        return below or most >= self._codes - 1

    def _damp(self, lo: float, hi: float, least: int, most: int) -> None:
        """The greatest gain that fits; plates apart or together where none does."""
        gain = self.gain
        while 0.5 * gain >= self._gains[0] and not self._fits(gain, lo, hi, _NEAR):
            gain *= 0.5
        if self._fits(gain, lo, hi, _NEAR):
            self._set_gain(gain)
        else:
            self._damp_most(1 if least + most < self._codes else -1)

    def _damp_most(self, apart: int) -> None:
        """The least gain; where it stands already, other plates."""
        if 0.5 * self.gain < self._gains[0]:
            self.plate = max(0, min(self._plates, self.plate + apart))
        gain = self.gain
        while 0.5 * gain >= self._gains[0]:
            gain *= 0.5
        self._set_gain(gain)

    def _relaxes(self, lo: float, hi: float) -> bool:
        """Whether plates that are nearer, or a greater gain, would fit with room."""
        if self.plate > 0:
            nearer = (1.0 + (self.plate - 1) * self._growth) / (1.0 + self.plate * self._growth)
            return self._fits(self.gain, nearer * lo, nearer * hi, _ROOM)
        gain = 2.0 * self.gain
        return gain <= self._gains[1] and self._fits(gain, lo, hi, _ROOM)

    def _relax(self) -> None:
        if self.plate > 0:
            self.plate -= 1
        else:
            self._set_gain(2.0 * self.gain)
        self._quiet = 0

    def _set_gain(self, gain: float) -> None:
        self._quiet = 0
        if gain != self.gain:
            self.trim = self._trimmed(gain)
            self.gain = gain


def extremes(codes: "Sequence[Codes]", n: int) -> "tuple[int, int]":
    """The least and the greatest of n codes of each input."""
    least = most = codes[0][0]
    for each in codes:
        for k in range(n):
            least, most = min(least, each[k]), max(most, each[k])
    return least, most
