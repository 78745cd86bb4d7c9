"""What the control unit knows of each kind of taxel: inputs, quantities, calibration."""

from sensor_node.firmware import inversion
from sensor_node.firmware.calibration import (
    adjusted,
    converter,
    distance,
    half_square,
    oscillator,
    part,
    plate,
    quotient,
    trimmer,
)
from sensor_node.firmware.rounding import down, up

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from types import ModuleType

    from sensor_node.firmware.calibration import Bounds, Sheet
    from sensor_node.firmware.inversion import Buffer, Codes


class Taxel:
    """One sensing element.

    Args:
        sheet: Its data sheet: SI values by name.
        functions: `sensor_node.firmware.inversion`, or a compiled copy of it.
    """

    quantities: "tuple[tuple[str, str], ...]" = ()
    """Quantity and UCUM unit, in the order of the channels."""
    inputs: "tuple[str, ...]" = ()
    """Inputs of the converter, in the order of their codes."""
    plated: "tuple[str, ...]" = ()
    """Quantities that are inverse to the distance of the plates."""

    def __init__(self, sheet: "Sheet", functions: "ModuleType" = inversion) -> None:
        self.sheet = sheet
        self._functions = functions
        self._converter = converter(sheet)
        self.adjust(1.0, 0)
        self._last = (1 << int(sheet["adc_bits"])) - 1
        self._reach = sheet["reach"]
        self._calibrate(sheet)

    def adjust(self, gain: float, trim: int) -> None:
        """Calculate with another gain of the amplifier and step of the trimmer."""
        tolerance = self.sheet["gain_tolerance"]
        gains = gain, gain
        if tolerance > 0.0:
            gains = down(gain * down(1.0 - tolerance)), up(gain * up(1.0 + tolerance))
        self._adc = self._converter
        if gains != (1.0, 1.0) or trim != 0:
            self._adc = adjusted(self._converter, gains, trimmer(self.sheet, trim))

    def move(self, before: int, steps: int) -> "Bounds":
        """Calculate with the plates at another step; gives the ratio of distances before to now."""
        raise NotImplementedError

    def _calibrate(self, sheet: "Sheet") -> None:
        raise NotImplementedError

    def measure(self, codes: "Sequence[Codes]", n: int, bounds: "Sequence[Buffer]") -> None:
        """Fill buffers, a lower and an upper one for each quantity, from each input's codes."""
        raise NotImplementedError


class CapacitiveTaxel(Taxel):
    """Capacitance and current over the chain of Fig. 3."""

    quantities = (("capacitance", "F"), ("current", "A"))
    inputs = ("current",)

    def _calibrate(self, sheet: "Sheet") -> None:
        self._factor = oscillator(sheet)

    def measure(self, codes: "Sequence[Codes]", n: int, bounds: "Sequence[Buffer]") -> None:
        """Capacitance in F, current in A."""
        self._functions.measure_capacitive(
            codes[0], n, self._last, self._adc, self._reach, self._factor, *bounds
        )


class TouchTaxel(Taxel):
    """Area, capacitance and energy of a touch."""

    quantities = (("area", "m2"), ("capacitance", "F"), ("energy", "J"))
    inputs = ("current",)
    plated = ("capacitance", "energy")

    def _calibrate(self, sheet: "Sheet") -> None:
        self._factor = oscillator(sheet)
        self._energy_factor = half_square(sheet)
        self._stand(0)

    def _stand(self, steps: int) -> None:
        per_area = plate(self.sheet, steps)
        self._area_factor = quotient((1.0, 1.0), per_area)
        self._reaches = self._reach, up(per_area[1] * self._reach)

    def move(self, before: int, steps: int) -> "Bounds":
        """Calculate with the plates at another step; gives the ratio of distances before to now."""
        self._stand(steps)
        return quotient(distance(self.sheet, before), distance(self.sheet, steps))

    def measure(self, codes: "Sequence[Codes]", n: int, bounds: "Sequence[Buffer]") -> None:
        """Area in m², capacitance in F, energy in J."""
        self._functions.measure_touch(
            codes[0],
            n,
            self._last,
            self._adc,
            self._reaches,
            self._factor,
            self._area_factor,
            self._energy_factor,
            *bounds,
        )


class InductiveTaxel(Taxel):
    """Frequency, inductance, and distance of a metal object."""

    quantities = (("frequency", "Hz"), ("inductance", "H"), ("distance", "m"))
    inputs = ("voltage",)

    def _calibrate(self, sheet: "Sheet") -> None:
        self._reference = part(sheet, "reference")
        self._capacitance = part(sheet, "capacitance")
        self._coil = (
            part(sheet, "inductance"),
            part(sheet, "inductance_change"),
            part(sheet, "damping"),
        )

    def measure(self, codes: "Sequence[Codes]", n: int, bounds: "Sequence[Buffer]") -> None:
        """Frequency in Hz, inductance in H, distance in m."""
        self._functions.measure_inductive(
            codes[0],
            n,
            self._last,
            self._adc,
            self._reach,
            self._reference,
            self._capacitance,
            self._coil,
            *bounds,
        )


class HybridTaxel(Taxel):
    """MagFES current and EcFES voltage, each behind an amplifier."""

    quantities = (("current", "A"), ("voltage", "V"))
    inputs = ("current", "voltage")

    def _calibrate(self, sheet: "Sheet") -> None:
        self._gains = part(sheet, "current_gain"), part(sheet, "voltage_gain")

    def measure(self, codes: "Sequence[Codes]", n: int, bounds: "Sequence[Buffer]") -> None:
        """Current in A, voltage in V."""
        for k in (0, 1):
            self._functions.measure_amplified(
                codes[k],
                n,
                self._last,
                self._adc,
                self._reach,
                self._gains[k],
                bounds[2 * k],
                bounds[2 * k + 1],
            )


CHAINS: "Mapping[str, type[Taxel]]" = {
    "capacitive": CapacitiveTaxel,
    "touch": TouchTaxel,
    "inductive": InductiveTaxel,
    "hybrid": HybridTaxel,
}
"""Class of each chain."""
