"""What a taxel knows of the air around it."""

from array import array

from eskin_sensor_node.firmware.calibration import signed_part
from eskin_sensor_node.firmware.inversion.air import REFERENCE_TEMPERATURE, UNUSED, change_bounds
from eskin_sensor_node.firmware.inversion.humidity import REFERENCE_HUMIDITY
from eskin_sensor_node.firmware.rounding import down, up
from eskin_sensor_node.firmware.taxel.hygrometer import HygrometerTaxel
from eskin_sensor_node.firmware.taxel.thermometer import ThermometerTaxel

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Sequence
    from types import ModuleType

    from eskin_sensor_node.firmware.calibration import Bounds, Sheet
    from eskin_sensor_node.firmware.inversion import Buffer, Codes

    Memory = tuple[array[int], array[float], array[float]]
    """Codes, and the bounds of what each of them means; slot by slot."""

SLOTS = 32
"""Codes of each sensor whose meaning is remembered: air is never as noisy as that."""
_SENSORS = (
    ("thermometer", ThermometerTaxel, "temperature", REFERENCE_TEMPERATURE, "permittivity_per_K"),
    ("hygrometer", HygrometerTaxel, "humidity", REFERENCE_HUMIDITY, "permittivity_per_percent"),
)


class Air:
    """Temperature and humidity: read along at a taxel's instants, or as its data sheet states.

    Args:
        sheet: The taxel's; a sensor that is read along stands in it under ``thermometer.`` or
            ``hygrometer.``.
        functions: `eskin_sensor_node.firmware.inversion`, or a compiled copy of it.

    Attributes:
        inputs: The sensors that are read along.
        inverted: Of each, how many codes had to be calculated so far.
    """

    def __init__(self, sheet: "Sheet", functions: "ModuleType") -> None:
        self._functions = functions
        self._stated = 1.0, 1.0
        self._sensors: list[tuple[ThermometerTaxel | HygrometerTaxel, Bounds, Memory]] = []
        self.inputs: list[str] = []
        for role, kind, quantity, reference, name in _SENSORS:
            own, slope = _part(sheet, role), signed_part(sheet, name)
            if own:
                self.inputs.append(role)
                self._sensors.append((kind(own, functions), slope, _memory()))
                continue
            limits = sheet[quantity + "_min"], sheet[quantity + "_max"]
            lo, hi = change_bounds(limits[0], limits[1], reference, slope)
            self._stated = down(self._stated[0] + lo), up(self._stated[1] + hi)
        self.inverted = [0] * len(self.inputs)

    def permittivity(
        self, codes: "Sequence[Codes]", n: int, lows: "Buffer", highs: "Buffer"
    ) -> None:
        """Fill buffers with the permittivity over the data sheet's, from the sensors' codes."""
        self._functions.measure_still(n, self._stated, lows, highs)
        for k, (sensor, slope, memory) in enumerate(self._sensors):
            self.inverted[k] += sensor.change(codes[k], n, slope, memory, lows, highs)


def _part(sheet: "Sheet", role: str) -> "dict[str, float]":
    """The data sheet of a sensor that is read along; empty if there is none."""
    start = role + "."
    return {key[len(start) :]: sheet[key] for key in sheet if key.startswith(start)}


def _memory() -> "Memory":
    unused = array("i", [UNUSED] * SLOTS)
    return unused, array("d", bytes(8 * SLOTS)), array("d", bytes(8 * SLOTS))
