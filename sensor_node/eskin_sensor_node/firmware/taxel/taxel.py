"""What all kinds of taxel have: a converter behind an amplifier, and a calibration."""

from eskin_sensor_node.firmware import inversion
from eskin_sensor_node.firmware.calibration import adjusted, converter, trimmer
from eskin_sensor_node.firmware.rounding import down, up

TYPE_CHECKING = False
if TYPE_CHECKING:
    from array import array
    from collections.abc import Mapping, Sequence
    from types import ModuleType

    from eskin_sensor_node.firmware.calibration import Bounds, Sheet
    from eskin_sensor_node.firmware.inversion import Buffer, Codes

    Memory = tuple[array[int], array[float], array[float]]
    """Codes, and the bounds of what each of them means; slot by slot."""


class Taxel:
    """One sensing element.

    Args:
        sheet: Its data sheet: SI values by name.
        functions: `eskin_sensor_node.firmware.inversion`, or a compiled copy of it.

    Attributes:
        last: The greatest code of its converter.
    """

    quantities: "tuple[tuple[str, str], ...]" = ()
    """Quantity and UCUM unit, in the order of the channels."""
    inputs: "tuple[str, ...]" = ()
    """Inputs of the converter, in the order of their codes."""
    amplified = 1
    """How many of them, the first ones, are behind the amplifier and the trimmer."""

    monotone: "tuple[str, ...]" = ()
    """Quantities whose bounds follow from one input's code alone, and ascend or descend with it."""
    derived: "tuple[str, ...]" = ()
    """Quantities of a cause, which a broken taxel does not measure any more."""
    inverted: "Sequence[int]" = ()
    """Of each sensor that is read along, how many codes had to be calculated so far."""

    def __init__(self, sheet: "Sheet", functions: "ModuleType" = inversion) -> None:
        self.sheet = sheet
        self._functions = functions
        self._converter = converter(sheet)
        self.adjust(1.0, 0)
        self.last = (1 << int(sheet["adc_bits"])) - 1
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

    def shared(self) -> "Mapping[str, Bounds]":
        """Bounds of α, by the quantities that are ``α·u`` with the same α in all samples.

        The bounds are those that `measure` multiplies u by, to the same bit.
        """
        return {}

    def move(self, before: int, steps: int) -> "Mapping[str, Bounds]":
        """Calculate with the plates at another step; gives by what quantities change.

        Only taxels with an actuator have it: without steps, adaptation never moves a plate.
        """
        raise NotImplementedError  # kinds without an actuator are never moved

    def _calibrate(self, sheet: "Sheet") -> None:
        """Take from the data sheet what `measure` needs; each kind has its own."""
        raise NotImplementedError  # abstract: MicroPython has no abc

    def measure(self, codes: "Sequence[Codes]", n: int, bounds: "Sequence[Buffer]") -> None:
        """Fill buffers, a lower and an upper one for each quantity, from each input's codes.

        Each kind has its own; MicroPython knows no abstract classes.
        """
        raise NotImplementedError  # abstract: MicroPython has no abc

    def surround(self, neighbours: int) -> None:
        """Sit among so many neighbours in the skin; most kinds do not feel them."""

    def separate(
        self, n: int, bounds: "Sequence[Buffer]", around: "Sequence[tuple[Buffer, Buffer]]"
    ) -> None:
        """Take back what neighbours hand on, out of what was measured.

        Args:
            n: Samples.
            bounds: What `measure` filled.
            around: What neighbours feel at the same instants, as far as it is known.
        """

    def felt(self, bounds: "Sequence[Buffer]") -> "tuple[Buffer, Buffer]":
        """What it hands on a share of; only taxels with neighbours have it."""
        raise NotImplementedError  # kinds without neighbours are never asked
