"""A capacitive polymer that measures the humidity."""

from eskin_sensor_node.firmware.calibration import oscillator, part
from eskin_sensor_node.firmware.taxel.taxel import Taxel

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Sequence

    from eskin_sensor_node.firmware.calibration import Bounds, Sheet
    from eskin_sensor_node.firmware.inversion import Buffer, Codes
    from eskin_sensor_node.firmware.taxel.taxel import Memory


class HygrometerTaxel(Taxel):
    """Relative humidity by a capacitive polymer, over the chain of Fig. 3."""

    quantities = (("humidity", "%"),)
    inputs = ("current",)

    def _calibrate(self, sheet: "Sheet") -> None:
        self._factor = oscillator(sheet)
        self._rest = part(sheet, "capacitance")
        self._sensitivity = part(sheet, "sensitivity")
        self._error = sheet["error_percent"]

    def change(
        self, codes: "Codes", n: int, slope: "Bounds", memory: "Memory", lo: "Buffer", hi: "Buffer"
    ) -> int:
        """Add to a permittivity what the humidity changes; gives how many codes were new."""
        return self._functions.measure_humidity_change(  # type: ignore[no-any-return]  # of a module
            codes,
            n,
            self.last,
            self._adc,
            self._reach,
            self._factor,
            self._rest,
            self._sensitivity,
            self._error,
            slope,
            *memory,
            lo,
            hi,
        )

    def measure(self, codes: "Sequence[Codes]", n: int, bounds: "Sequence[Buffer]") -> None:
        """Relative humidity in %."""
        self._functions.measure_humidity(
            codes[0],
            n,
            self.last,
            self._adc,
            self._reach,
            self._factor,
            self._rest,
            self._sensitivity,
            self._error,
            *bounds,
        )
