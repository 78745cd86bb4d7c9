"""A pressed pad of a skin."""

from sensor_node.firmware.calibration import distance, oscillator, pressed, quotient
from sensor_node.firmware.taxel.air import Air
from sensor_node.firmware.taxel.taxel import Taxel

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from sensor_node.firmware.calibration import Bounds, Sheet
    from sensor_node.firmware.inversion import Buffer, Codes


class PadTaxel(Taxel):
    """Capacitance and current over the chain of Fig. 3, and what presses the plates."""

    quantities = (
        ("capacitance", "F"),
        ("current", "A"),
        ("plate_distance", "m"),
        ("contact_area", "m2"),
        ("pressure", "Pa"),
    )

    def _calibrate(self, sheet: "Sheet") -> None:
        self._factor = oscillator(sheet)
        self._pad = pressed(sheet, 0)
        self._air = Air(sheet, self._functions)
        self.inputs = tuple(["current"] + self._air.inputs)  # noqa: RUF005 - MicroPython unpacks calls only

    def move(self, before: int, steps: int) -> "Mapping[str, Bounds]":
        """Calculate with the plates at another step; gives by what quantities change."""
        self._pad = pressed(self.sheet, steps)
        ends = distance(self.sheet, before), distance(self.sheet, steps)
        nearer, farther = quotient(*ends), quotient(ends[1], ends[0])
        return {"capacitance": nearer, "current": farther, "plate_distance": farther}

    def measure(self, codes: "Sequence[Codes]", n: int, bounds: "Sequence[Buffer]") -> None:
        """Capacitance in F, current in A, mean distance in m, area in m², pressure in Pa."""
        permittivity = self._air.permittivity(codes[1:], n)
        self._functions.measure_pad(
            codes[0],
            n,
            self._last,
            self._adc,
            self._reach,
            self._factor,
            self._pad,
            *permittivity,
            *bounds,
        )
