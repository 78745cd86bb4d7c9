"""What a taxel knows of the air around it."""

from array import array

from sensor_node.firmware.taxel.hygrometer import HygrometerTaxel
from sensor_node.firmware.taxel.thermometer import ThermometerTaxel

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Sequence
    from types import ModuleType

    from sensor_node.firmware.calibration import Sheet
    from sensor_node.firmware.inversion import Buffer, Codes
    from sensor_node.firmware.taxel.taxel import Taxel


class Air:
    """Temperature and humidity: read along at a taxel's instants, or as its data sheet states.

    Args:
        sheet: The taxel's; a sensor that is read along stands in it under ``thermometer.`` or
            ``hygrometer.``.
        functions: `sensor_node.firmware.inversion`, or a compiled copy of it.
    """

    def __init__(self, sheet: "Sheet", functions: "ModuleType") -> None:
        self._functions = functions
        self._slopes = sheet["permittivity_per_K"], sheet["permittivity_per_percent"]
        limits = ("temperature_min", "temperature_max", "humidity_min", "humidity_max")
        self._stated = [sheet[name] for name in limits]
        self._sensors: list[Taxel | None] = [
            _sensor(ThermometerTaxel, "thermometer", sheet, functions),
            _sensor(HygrometerTaxel, "hygrometer", sheet, functions),
        ]
        names = ("thermometer", "hygrometer")
        self.inputs = [name for k, name in enumerate(names) if self._sensors[k] is not None]
        self._grow(0)

    def permittivity(self, codes: "Sequence[Codes]", n: int) -> "tuple[Buffer, Buffer]":
        """Bounds of the permittivity over the data sheet's, from the codes of its inputs."""
        if n > len(self._bounds[4]):
            self._grow(n)
        if not self.inputs:
            return self._bounds[4], self._bounds[5]
        used = 0
        for k, sensor in enumerate(self._sensors):
            if sensor is not None:
                sensor.measure(codes[used : used + 1], n, self._bounds[2 * k : 2 * k + 2])
                used += 1
        self._functions.measure_permittivity(n, self._slopes, *self._bounds)
        return self._bounds[4], self._bounds[5]

    def _grow(self, n: int) -> None:
        """Make buffers of n samples: what is stated, and the permittivity."""
        length = n if self.inputs else 1
        self._bounds = [array("d", [value] * length) for value in self._stated]
        self._bounds += [array("d", bytes(8 * length)) for _ in ("lower", "upper")]
        if not self.inputs:
            # Nothing is read along: it is the same in all samples.
            self._functions.measure_permittivity(1, self._slopes, *self._bounds)
            for k in (4, 5):
                self._bounds[k] = array("d", [self._bounds[k][0]] * n)


def _sensor(
    kind: "type[Taxel]", name: str, sheet: "Sheet", functions: "ModuleType"
) -> "Taxel | None":
    """A sensor that is read along, if there is one."""
    start = name + "."
    own = {key[len(start) :]: sheet[key] for key in sheet if key.startswith(start)}
    return kind(own, functions) if own else None
