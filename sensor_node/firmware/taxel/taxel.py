"""What all kinds of taxel have: a converter behind an amplifier, and a calibration."""

from sensor_node.firmware import inversion
from sensor_node.firmware.calibration import converter
from sensor_node.firmware.rounding import down, up

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Sequence
    from types import ModuleType

    from sensor_node.firmware.calibration import Sheet
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

    def __init__(self, sheet: "Sheet", functions: "ModuleType" = inversion) -> None:
        self._functions = functions
        self._converter = self._adc = converter(sheet)
        self._last = (1 << int(sheet["adc_bits"])) - 1
        self._reach = sheet["reach"]
        self._calibrate(sheet)

    def amplify(self, gain: float) -> None:
        """Calculate with another gain of the amplifier before the converter."""
        step_lo, step_hi, offset_lo, offset_hi, nonlinearity = self._converter
        self._adc = (
            down(step_lo / gain),
            up(step_hi / gain),
            down(offset_lo / gain),
            up(offset_hi / gain),
            nonlinearity,
        )

    def _calibrate(self, sheet: "Sheet") -> None:
        raise NotImplementedError

    def measure(self, codes: "Sequence[Codes]", n: int, bounds: "Sequence[Buffer]") -> None:
        """Fill buffers, a lower and an upper one for each quantity, from each input's codes."""
        raise NotImplementedError
