"""An electrode on the skin."""

from eskin_sensor_node.firmware.calibration import part
from eskin_sensor_node.firmware.rounding import up
from eskin_sensor_node.firmware.taxel.taxel import Taxel

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Sequence

    from eskin_sensor_node.firmware.calibration import Sheet
    from eskin_sensor_node.firmware.inversion import Buffer, Codes


class BioelectricTaxel(Taxel):
    """Voltage that the body makes, behind an amplifier with an offset."""

    quantities = (("bioelectric", "V"),)
    inputs = ("voltage",)
    monotone = ("bioelectric",)

    def _calibrate(self, sheet: "Sheet") -> None:
        self._gain = part(sheet, "electrode_gain")
        self._reach = up(self._reach + up(self._gain[1] * sheet["input_offset"]))

    def measure(self, codes: "Sequence[Codes]", n: int, bounds: "Sequence[Buffer]") -> None:
        """Voltage in V."""
        self._functions.measure_amplified(
            codes[0], n, self.last, self._adc, self._reach, self._gain, *bounds
        )
