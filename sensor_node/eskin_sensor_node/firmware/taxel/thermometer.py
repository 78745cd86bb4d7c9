"""A platinum resistor that measures the temperature."""

from eskin_sensor_node.firmware.calibration import part, platinum
from eskin_sensor_node.firmware.rounding import down, up
from eskin_sensor_node.firmware.taxel.taxel import Taxel

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Sequence

    from eskin_sensor_node.firmware.calibration import Bounds, Sheet
    from eskin_sensor_node.firmware.inversion import Buffer, Codes
    from eskin_sensor_node.firmware.taxel.taxel import Memory


class ThermometerTaxel(Taxel):
    """Temperature by a platinum resistor in a divider (IEC 60751)."""

    quantities = (("temperature", "Cel"),)
    inputs = ("share",)

    def _calibrate(self, sheet: "Sheet") -> None:
        series, nominal = part(sheet, "series_resistance"), sheet["nominal"]
        self._divider = down(series[0] / nominal), up(series[1] / nominal)
        self._tolerance = platinum(sheet)

    def change(
        self, codes: "Codes", n: int, slope: "Bounds", memory: "Memory", lo: "Buffer", hi: "Buffer"
    ) -> int:
        """Add to a permittivity what the temperature changes; gives how many codes were new."""
        return self._functions.measure_warm(  # type: ignore[no-any-return]  # of a module
            codes,
            n,
            self._last,
            self._adc,
            self._reach,
            self._divider,
            self._tolerance,
            slope,
            *memory,
            lo,
            hi,
        )

    def measure(self, codes: "Sequence[Codes]", n: int, bounds: "Sequence[Buffer]") -> None:
        """Temperature in °C."""
        self._functions.measure_temperature(
            codes[0], n, self._last, self._adc, self._reach, self._divider, self._tolerance, *bounds
        )
