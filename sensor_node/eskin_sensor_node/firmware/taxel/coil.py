"""A coil of a skin, which sees metal in two ways."""

from math import sqrt

from eskin_sensor_node.firmware.arctangent import arctangent
from eskin_sensor_node.firmware.calibration import converter, part, product, quotient
from eskin_sensor_node.firmware.rounding import TWO_PI_HI, TWO_PI_LO, down, up
from eskin_sensor_node.firmware.taxel.inductive import InductiveTaxel

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Sequence

    from eskin_sensor_node.firmware.calibration import Bounds, Sheet
    from eskin_sensor_node.firmware.inversion import Buffer, Codes


class CoilTaxel(InductiveTaxel):
    """Metal by the oscillator's frequency, and by its eddy currents' amplitude and phase."""

    quantities = (
        ("frequency", "Hz"),
        ("inductance", "H"),
        ("distance", "m"),
        ("eddy_amplitude", "1"),
        ("eddy_phase", "rad"),
    )
    inputs = ("voltage", "in_phase", "quadrature")
    monotone = ("frequency", "inductance")

    def _calibrate(self, sheet: "Sheet") -> None:
        super()._calibrate(sheet)
        own = dict(sheet)
        own["adc_min"], own["adc_max"] = 0.0, sheet["demodulator_max"]
        self._demodulator = converter(own)
        self._empty = _empty(sheet)

    def measure(self, codes: "Sequence[Codes]", n: int, bounds: "Sequence[Buffer]") -> None:
        """Frequency in Hz, inductance in H, distance in m; amplitude, and phase in rad."""
        super().measure(codes[:1], n, bounds[:6])
        self._functions.measure_eddy(
            codes[1],
            codes[2],
            n,
            self.last,
            self._demodulator,
            self._reach,
            *self._empty,
            *bounds[6:],
        )


def _empty(sheet: "Sheet") -> "tuple[Bounds, Bounds]":
    """``|Z0|/(G·V)`` and ``atan(R/(ωL0))`` of a coil without metal."""
    resistance = part(sheet, "coil_resistance")
    omega = product((TWO_PI_LO, TWO_PI_HI), part(sheet, "excitation"))
    reactance = product(omega, part(sheet, "inductance"))
    r, x = product(resistance, resistance), product(reactance, reactance)
    modulus = down(sqrt(down(r[0] + x[0]))), up(sqrt(up(r[1] + x[1])))
    ratio = quotient(resistance, reactance)
    driven = product(part(sheet, "drive"), part(sheet, "demodulator_gain"))
    return quotient(modulus, driven), (arctangent(ratio[0])[0], arctangent(ratio[1])[1])
