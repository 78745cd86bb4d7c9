"""A touch that covers a plate."""

from eskin_sensor_node.firmware.calibration import (
    EPSILON_0,
    distance,
    oscillator,
    part,
    product,
    quotient,
)
from eskin_sensor_node.firmware.rounding import up
from eskin_sensor_node.firmware.taxel.taxel import Taxel

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from eskin_sensor_node.firmware.calibration import Bounds, Sheet
    from eskin_sensor_node.firmware.inversion import Buffer, Codes


class TouchTaxel(Taxel):
    """Area, capacitance and energy of a touch."""

    quantities = (("area", "m2"), ("capacitance", "F"), ("energy", "J"))
    inputs = ("current",)
    monotone = ("area", "capacitance", "energy")
    derived = ("area",)

    def _calibrate(self, sheet: "Sheet") -> None:
        self._factor = oscillator(sheet)
        self._energy_factor = _half_square(sheet)
        self._stand(0)

    def _stand(self, steps: int) -> None:
        per_area = _per_area(self.sheet, steps)
        self._area_factor = quotient((1.0, 1.0), per_area)
        self._reaches = self._reach, up(per_area[1] * self._reach)

    def move(self, before: int, steps: int) -> "Mapping[str, Bounds]":
        """Calculate with the plates at another step; gives by what quantities change."""
        self._stand(steps)
        ratio = quotient(distance(self.sheet, before), distance(self.sheet, steps))
        return {"capacitance": ratio, "energy": ratio}

    def shared(self) -> "Mapping[str, Bounds]":
        """The oscillator's factor: a capacitance is ``factor / I`` (eq. 6)."""
        return {"capacitance": self._factor}

    def measure(self, codes: "Sequence[Codes]", n: int, bounds: "Sequence[Buffer]") -> None:
        """Area in m², capacitance in F, energy in J."""
        self._functions.measure_touch(
            codes[0],
            n,
            self.last,
            self._adc,
            self._reaches,
            self._factor,
            self._area_factor,
            self._energy_factor,
            *bounds,
        )


def _per_area(sheet: "Sheet", steps: int) -> "Bounds":
    """``ε/d``: a plate's capacitance for each area (eq. 2)."""
    permittivity = product(EPSILON_0, part(sheet, "relative_permittivity"))
    return quotient(permittivity, distance(sheet, steps))


def _half_square(sheet: "Sheet") -> "Bounds":
    """``½V²``: the energy for each capacitance."""
    supply = part(sheet, "supply")
    lo, hi = product(supply, supply)
    return 0.5 * lo, 0.5 * hi
