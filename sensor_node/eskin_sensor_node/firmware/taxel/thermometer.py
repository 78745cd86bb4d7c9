"""A platinum resistor that measures the temperature."""

from eskin_sensor_node.firmware.calibration import part
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
    monotone = ("temperature",)

    def _calibrate(self, sheet: "Sheet") -> None:
        series, nominal = part(sheet, "series_resistance"), sheet["nominal"]
        self._divider = down(series[0] / nominal), up(series[1] / nominal)
        self._tolerance = _deviation(sheet)

    def change(
        self, codes: "Codes", n: int, slope: "Bounds", memory: "Memory", lo: "Buffer", hi: "Buffer"
    ) -> int:
        """Add to a permittivity what the temperature changes; gives how many codes were new."""
        return self._functions.measure_thermal_change(  # type: ignore[no-any-return]  # of a module
            codes,
            n,
            self.last,
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
            codes[0], n, self.last, self._adc, self._reach, self._divider, self._tolerance, *bounds
        )


def _deviation(sheet: "Sheet") -> "Bounds":
    """How far a platinum resistor is off: in K, and for each K away from 0 °C.

    At the true t it shows ``s = t ± (a + b·|t|)``, so t is ``s ± (a + b·(|s| + a)/(1 - b))``.
    """
    constant, growing = sheet["tolerance_K"], sheet["tolerance_per_K"]
    growing = up(growing / down(1.0 - growing))
    return up(constant + up(growing * constant)), growing
