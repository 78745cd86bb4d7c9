"""What the firmware knows of its energy: intervals, a verdict, and what to shed.

The supercapacitor holds ``½·C·V²``. Over a horizon the balance is ``harvest - consumption =
E_end - E_begin`` (plus what a full supercapacitor had no room for), so the verdict needs no
knowledge of the harvest, and the harvest follows from what was spent.
"""

from math import sqrt

from eskin_sensor_node.firmware.calibration import converter, part, product
from eskin_sensor_node.firmware.charge import read_charge, write_charge
from eskin_sensor_node.firmware.rounding import INFINITY, down, up

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Sequence

    from eskin_sensor_node.firmware.calibration import Bounds, Sheet

    Energy = tuple[Bounds, Bounds, int, int]

IMPOSSIBLE = 0
POSSIBLE = 1
CERTAIN = 2
"""Verdicts: whether the node sustains itself."""
FULL = 0
ADAPTIVE = 1
PEAKS = 2
SLEEP = 3
"""Stages of shedding load."""
_FLOORS = (0.5, 0.3, 0.15)
"""State of charge below which stages 1, 2 and 3 begin."""
_HYSTERESIS = 0.05
_BILLION = 1000000000
_SLACK = 1.0 / 1073741824
"""Steps of the converter that an emulated chain may round away at most."""
_COUNTS = ("cycle", "conversion", "sent", "received", "written", "wake_up")
"""What each of the first counts of work costs, in their order."""
_FEWEST = 6
_ASLEEP = 7
_ON = 8
_SPAN = 9
"""Places of the others."""


def thrice(lo: float, hi: float) -> int:
    """The verdict on a difference that is not to be negative."""
    if lo >= 0.0:
        return CERTAIN
    return IMPOSSIBLE if hi < 0.0 else POSSIBLE


class EnergyManager:
    """Follows the supply.

    Args:
        sheet: Data sheet in SI values; ``pulse_lo`` and ``pulse_hi`` bound the sensor's pulse in J,
            ``idle_lo`` and ``idle_hi`` what flows while nothing is done, in W.

    Attributes:
        stored: Bounds of the stored energy in J.
        charge: Bounds of the state of charge: 0 at brown-out, 1 at the rated voltage.
        spent: Bounds of what the work of the present horizon cost, J.
        harvested: Bounds of what came in during it, J.
        verdict: On the last whole horizon; before one is over, on the present one.
        stage: How much load is shed.
    """

    def __init__(self, sheet: "Sheet") -> None:
        self._costs = [part(sheet, name) for name in _COUNTS]
        self._costs[1] = (
            down(self._costs[1][0] + sheet["pulse_lo"]),
            up(self._costs[1][1] + sheet["pulse_hi"]),
        )
        self._sleeping = part(sheet, "sleeping")
        self._idle = sheet["idle_lo"], sheet["idle_hi"]
        self._adc = converter(sheet)
        self._last = (1 << int(sheet["adc_bits"])) - 1
        self._half = part(sheet, "capacitance")
        self._half = 0.5 * self._half[0], 0.5 * self._half[1]
        self._series = part(sheet, "series_resistance")
        self._leakage = part(sheet, "leakage_resistance")
        self._drop = product(self._series, part(sheet, "active_current"))
        self._empty, self._rated = sheet["brown_out_voltage"], sheet["rated_voltage"]
        self._horizon = int(sheet["horizon_ns"])
        self._code = self._first = -1
        self._lasted = 0
        self._decided = False
        self.stage = FULL
        self.verdict = POSSIBLE
        self.stored = (0.0, INFINITY)
        self.charge = (0.0, 1.0)
        self._begin_horizon()

    @property
    def status(self) -> "Energy":
        """The energy of a status message."""
        return self.stored, self.charge, self.verdict, self.stage

    def watch(self, code: int, work: "Sequence[int]") -> None:
        """Take a code of the supply's converter, and what the machine did since the last.

        Args:
            code: Of the voltage at present.
            work: Cycles at most, conversions, bytes sent, received and written, wake-ups, cycles
                at least, ns asleep at least, ns with power, ns in all.
        """
        self._code = code
        volts = self._volts(code)
        self.stored = self._energy(volts)
        self.charge = self._charged(volts)
        if self._first < 0:
            self._first = code
        else:
            self._count(work, volts)
        self._balance()
        if self._lasted >= self._horizon:
            self._decided = True
            self._begin_horizon()
            self._first = code
        self._shed()

    def rest(self, time: "tuple[int, int]") -> bytes:
        """The charge to store when the firmware stops, at an instant in UTC ns."""
        return write_charge(self.stored[0], time[0])

    def recall(self, record: bytes, time: "tuple[int, int]") -> None:
        """Begin with the stored charge, at an instant in UTC ns; the first code narrows it."""
        least = read_charge(record, time[1], leakage=self._leakage, half=self._half)
        self.stored = least, up(self._half[1] * up(self._rated * self._rated))
        volts = max(0.0, down(sqrt(max(0.0, down(least / self._half[1])))))
        self.charge = self._charged((volts, self._rated))

    def _begin_horizon(self) -> None:
        self._first = -1
        self._lasted = 0
        self._clipped = False
        self.spent = self._lost = (0.0, 0.0)
        self.harvested = (0.0, INFINITY)

    def _volts(self, code: int) -> "Bounds":
        """Open-circuit voltage behind a code; an end code has an unbounded side."""
        step_lo, step_hi, offset_lo, offset_hi, nonlinearity = self._adc
        low = down(down(down(code - nonlinearity) * step_lo) + offset_lo)
        high = up(up(up(code + 1.0 + nonlinearity) * step_hi) + offset_hi)
        low = 0.0 if code == 0 else down(low + self._drop[0])
        return max(0.0, low), INFINITY if code == self._last else up(high + self._drop[1])

    def _energy(self, volts: "Bounds") -> "Bounds":
        square = down(volts[0] * volts[0]), up(volts[1] * volts[1])
        return max(0.0, down(self._half[0] * square[0])), up(self._half[1] * square[1])

    def _charged(self, volts: "Bounds") -> "Bounds":
        """``(V² - V_empty²)/(V_rated² - V_empty²)``: the capacitance cancels."""
        empty, rated = self._empty, self._rated
        span = (
            down((rated - empty) * down(rated + empty)),
            up(up(rated - empty) * up(rated + empty)),
        )
        low = down(down(down(volts[0] - empty) * (volts[0] + empty)) / span[1])
        high = up(up(up(volts[1] - empty) * up(volts[1] + empty)) / down(span[0]))
        return max(0.0, min(low, 1.0)), max(0.0, min(high, 1.0))

    def _count(self, work: "Sequence[int]", volts: "Bounds") -> None:
        low = down(work[_FEWEST] * self._costs[0][0])
        high = up(work[0] * self._costs[0][1])
        for k in range(1, len(_COUNTS)):
            low = down(low + down(work[k] * self._costs[k][0]))
            high = up(high + up(work[k] * self._costs[k][1]))
        on = down(work[_ON] / _BILLION), up(work[_ON] / _BILLION)
        low = down(low + down(down(work[_ASLEEP] / _BILLION) * self._sleeping[0]))
        high = up(high + up(on[1] * self._sleeping[1]))
        low = down(low + down(on[0] * self._idle[0]))
        high = up(high + up(on[1] * self._idle[1]))
        self.spent = max(0.0, down(self.spent[0] + low)), up(self.spent[1] + high)
        self._lost = self._losses(max(0.0, low), high, work[_SPAN])
        self._lasted += work[_SPAN]
        self._clipped = self._clipped or volts[1] >= self._rated

    def _losses(self, low: float, high: float, span: int) -> "Bounds":
        """What leaks and warms the series resistance, added to that of before."""
        if span == 0:
            return self._lost
        seconds = down(span / _BILLION), up(span / _BILLION)
        empty, rated = self._empty, self._rated
        leaked = (
            down(down(down(empty * empty) / self._leakage[1]) * seconds[0]),
            up(up(up(rated * rated) / self._leakage[0]) * seconds[1]),
        )
        current = down(low / rated), up(high / empty)
        burnt = (
            down(down(down(current[0] * current[0]) * self._series[0]) / seconds[1]),
            up(up(up(current[1] * current[1]) * self._series[1]) / seconds[0]),
        )
        return (
            max(0.0, down(self._lost[0] + max(0.0, down(leaked[0] + burnt[0])))),
            up(self._lost[1] + up(leaked[1] + burnt[1])),
        )

    def _change(self) -> "Bounds":
        """Stored energy now less that at the horizon's begin.

        Both voltages share their gain error, offset and capacitance, so their difference is
        tighter than that of their bounds.
        """
        steps = self._code - self._first
        if 0 in (self._code, self._first) or self._last in (self._code, self._first):
            return -INFINITY, INFINITY
        reach = up(1.0 + 2.0 * self._adc[4] + _SLACK)
        first, now = self._volts(self._first), self._volts(self._code)
        # The drop is the same one twice, and cancels.
        sums = down(first[0] + now[0]), up(first[1] + now[1])
        low, high = down(steps - reach), up(steps + reach)
        low = low * (self._adc[0] if low > 0.0 else self._adc[1])
        high = high * (self._adc[1] if high > 0.0 else self._adc[0])
        return self._scaled(down(low), sums, lower=True), self._scaled(up(high), sums, lower=False)

    def _scaled(self, volts: float, sums: "Bounds", *, lower: bool) -> float:
        """``½·C·ΔV·(V1 + V2)``, rounded outward."""
        wide = lower == (volts < 0.0)
        factor = up(self._half[1] * sums[1]) if wide else down(self._half[0] * sums[0])
        return down(volts * factor) if lower else up(volts * factor)

    def _balance(self) -> None:
        low, high = self._change()
        if self._clipped:
            high = INFINITY
        self.harvested = (
            max(0.0, down(low + down(self.spent[0] + self._lost[0]))),
            up(high + up(self.spent[1] + self._lost[1])),
        )
        if not self._decided or self._lasted >= self._horizon:
            self.verdict = thrice(low, high) if self._lasted > 0 else POSSIBLE

    def _shed(self) -> None:
        """Shed where charge may be too low; take up again where it certainly suffices."""
        while self.stage < SLEEP and self.charge[0] < _FLOORS[self.stage]:
            self.stage += 1
        while self.stage > FULL and self.charge[0] > _FLOORS[self.stage - 1] + _HYSTERESIS:
            self.stage -= 1
