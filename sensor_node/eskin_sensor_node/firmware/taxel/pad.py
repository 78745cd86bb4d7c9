"""A pressed pad of a skin, and the sensors of the air that it reads along."""

from array import array

from eskin_sensor_node.firmware.calibration import (
    EPSILON_0,
    distance,
    oscillator,
    part,
    product,
    quotient,
    signed_part,
)
from eskin_sensor_node.firmware.inversion.hygrometer import REFERENCE_HUMIDITY
from eskin_sensor_node.firmware.inversion.pad import REFERENCE_TEMPERATURE, UNUSED, change_bounds
from eskin_sensor_node.firmware.rounding import down, up
from eskin_sensor_node.firmware.taxel.hygrometer import HygrometerTaxel
from eskin_sensor_node.firmware.taxel.taxel import Taxel
from eskin_sensor_node.firmware.taxel.thermometer import ThermometerTaxel

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from types import ModuleType

    from eskin_sensor_node.firmware.calibration import Bounds, Sheet
    from eskin_sensor_node.firmware.inversion import Buffer, Codes
    from eskin_sensor_node.firmware.taxel.taxel import Memory

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
        self._functions.measure_permittivity(n, self._stated, lows, highs)
        for k, (sensor, slope, memory) in enumerate(self._sensors):
            self.inverted[k] += sensor.change(codes[k], n, slope, memory, lows, highs)


def _part(sheet: "Sheet", role: str) -> "dict[str, float]":
    """The data sheet of a sensor that is read along; empty if there is none."""
    start = role + "."
    return {key[len(start) :]: sheet[key] for key in sheet if key.startswith(start)}


def _memory() -> "Memory":
    unused = array("i", [UNUSED] * SLOTS)
    return unused, array("d", bytes(8 * SLOTS)), array("d", bytes(8 * SLOTS))


class PadTaxel(Taxel):
    """Capacitance and current over the chain of Fig. 3, and what presses the plates."""

    quantities = (
        ("capacitance", "F"),
        ("current", "A"),
        ("plate_distance", "m"),
        ("contact_area", "m2"),
        ("pressure", "Pa"),
    )

    monotone = ("capacitance", "current")
    derived = ("plate_distance", "contact_area", "pressure")

    def _calibrate(self, sheet: "Sheet") -> None:
        self._factor = oscillator(sheet)
        self._stand(0)
        self._area = part(sheet, "plate_area")
        self._most = sheet["pressure_max"]
        self._doubtful = int(sheet["doubtful_neighbours"])
        self.surround(1)
        self.air = Air(sheet, self._functions)
        self.inverted = self.air.inverted
        self.inputs = tuple(["current"] + self.air.inputs)  # noqa: RUF005 - MicroPython unpacks calls only

    def _stand(self, steps: int) -> None:
        """Take ε0·εr·A, the distance at rest and the elasticity, with the plates at a step."""
        permittivity = product(EPSILON_0, part(self.sheet, "relative_permittivity"))
        plates = product(permittivity, part(self.sheet, "plate_area"))
        self._pad = plates, distance(self.sheet, steps), part(self.sheet, "elasticity")

    def surround(self, neighbours: int) -> None:
        """Sit among so many neighbours in the skin, whether they are measured or not."""
        self._neighbours = neighbours
        self._share = up(self.sheet["crosstalk"] / max(neighbours, 1))

    def move(self, before: int, steps: int) -> "Mapping[str, Bounds]":
        """Calculate with the plates at another step; gives by what quantities change."""
        self._stand(steps)
        ends = distance(self.sheet, before), distance(self.sheet, steps)
        nearer, farther = quotient(*ends), quotient(ends[1], ends[0])
        return {"capacitance": nearer, "current": farther, "plate_distance": farther}

    def shared(self) -> "Mapping[str, Bounds]":
        """The oscillator's factor: a capacitance is ``factor / I`` (eq. 6)."""
        return {"capacitance": self._factor}

    def measure(self, codes: "Sequence[Codes]", n: int, bounds: "Sequence[Buffer]") -> None:
        """Capacitance in F, current in A, mean distance in m, what it feels in Pa."""
        self.air.permittivity(codes[1:], n, bounds[4], bounds[5])
        self._functions.measure_felt(
            codes[0],
            n,
            self.last,
            self._adc,
            self._reach,
            self._factor,
            self._pad,
            *bounds[:6],
            *bounds[8:],
        )

    def separate(
        self, n: int, bounds: "Sequence[Buffer]", around: "Sequence[tuple[Buffer, Buffer]]"
    ) -> None:
        """Contact area in m², pressure in Pa."""
        least, total = bounds[6], bounds[7]
        if self._doubtful >= len(around):
            around = ()
        missing = self._neighbours - len(around)
        self._functions.measure_unknown(n, self._most, missing, total, least)
        for lows, highs in around:
            self._functions.measure_neighbour(n, self._most, lows, highs, total, least)
        handed = up(self.sheet["crosstalk"] * self._most)
        crosstalk = self._share, self._doubtful, handed
        self._functions.measure_pressure(n, self._area, self._most, crosstalk, *bounds[6:])

    def felt(self, bounds: "Sequence[Buffer]") -> "tuple[Buffer, Buffer]":
        """Pressure in Pa: at least its own."""
        return bounds[8], bounds[9]
