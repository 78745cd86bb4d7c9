"""The ICM hybrid."""

from eskin_sensor_node.firmware.calibration import part
from eskin_sensor_node.firmware.taxel.taxel import Taxel

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Sequence

    from eskin_sensor_node.firmware.calibration import Sheet
    from eskin_sensor_node.firmware.inversion import Buffer, Codes


class HybridTaxel(Taxel):
    """MagFES current and EcFES voltage, each behind an amplifier."""

    quantities = (("current", "A"), ("voltage", "V"))
    inputs = ("current", "voltage")
    amplified = 2

    def _calibrate(self, sheet: "Sheet") -> None:
        self._gains = part(sheet, "current_gain"), part(sheet, "voltage_gain")

    def measure(self, codes: "Sequence[Codes]", n: int, bounds: "Sequence[Buffer]") -> None:
        """Current in A, voltage in V."""
        for k in (0, 1):
            self._functions.measure_amplified(
                codes[k],
                n,
                self.last,
                self._adc,
                self._reach,
                self._gains[k],
                bounds[2 * k],
                bounds[2 * k + 1],
            )
