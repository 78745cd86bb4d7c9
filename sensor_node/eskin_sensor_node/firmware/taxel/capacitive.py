"""Taxels whose capacitance is measured over the chain of Fig. 3."""

from eskin_sensor_node.firmware.calibration import oscillator
from eskin_sensor_node.firmware.taxel.taxel import Taxel

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from eskin_sensor_node.firmware.calibration import Bounds, Sheet
    from eskin_sensor_node.firmware.inversion import Buffer, Codes


class CapacitiveTaxel(Taxel):
    """Capacitance and current over the chain of Fig. 3."""

    quantities = (("capacitance", "F"), ("current", "A"))
    inputs = ("current",)
    monotone = ("capacitance", "current")

    def _calibrate(self, sheet: "Sheet") -> None:
        self._factor = oscillator(sheet)

    def shared(self) -> "Mapping[str, Bounds]":
        """The oscillator's factor: a capacitance is ``factor / I`` (eq. 6)."""
        return {"capacitance": self._factor}

    def measure(self, codes: "Sequence[Codes]", n: int, bounds: "Sequence[Buffer]") -> None:
        """Capacitance in F, current in A."""
        self._functions.measure_capacitive(
            codes[0], n, self.last, self._adc, self._reach, self._factor, *bounds
        )
