"""A pressed pad of a skin."""

from eskin_sensor_node.firmware.calibration import distance, oscillator, part, pressed, quotient
from eskin_sensor_node.firmware.rounding import up
from eskin_sensor_node.firmware.taxel.air import Air
from eskin_sensor_node.firmware.taxel.taxel import Taxel

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from eskin_sensor_node.firmware.calibration import Bounds, Sheet
    from eskin_sensor_node.firmware.inversion import Buffer, Codes


class PadTaxel(Taxel):
    """Capacitance and current over the chain of Fig. 3, and what presses the plates."""

    quantities = (
        ("capacitance", "F"),
        ("current", "A"),
        ("plate_distance", "m"),
        ("contact_area", "m2"),
        ("pressure", "Pa"),
    )

    derived = ("plate_distance", "contact_area", "pressure")

    def _calibrate(self, sheet: "Sheet") -> None:
        self._factor = oscillator(sheet)
        self._pad = pressed(sheet, 0)
        self._area = part(sheet, "plate_area")
        self._most = sheet["pressure_max"]
        self._doubtful = int(sheet["doubtful_neighbours"])
        self.surround(1)
        self.air = Air(sheet, self._functions)
        self.inverted = self.air.inverted
        self.inputs = tuple(["current"] + self.air.inputs)  # noqa: RUF005 - MicroPython unpacks calls only

    def surround(self, neighbours: int) -> None:
        """Sit among so many neighbours in the skin, whether they are measured or not."""
        self._neighbours = neighbours
        self._share = up(self.sheet["crosstalk"] / max(neighbours, 1))

    def move(self, before: int, steps: int) -> "Mapping[str, Bounds]":
        """Calculate with the plates at another step; gives by what quantities change."""
        self._pad = pressed(self.sheet, steps)
        ends = distance(self.sheet, before), distance(self.sheet, steps)
        nearer, farther = quotient(*ends), quotient(ends[1], ends[0])
        return {"capacitance": nearer, "current": farther, "plate_distance": farther}

    def measure(self, codes: "Sequence[Codes]", n: int, bounds: "Sequence[Buffer]") -> None:
        """Capacitance in F, current in A, mean distance in m, what it feels in Pa."""
        self.air.permittivity(codes[1:], n, bounds[4], bounds[5])
        self._functions.measure_felt(
            codes[0],
            n,
            self._last,
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
        self._functions.measure_nobody(n, self._most, missing, total, least)
        for lows, highs in around:
            self._functions.measure_neighbour(n, self._most, lows, highs, total, least)
        handed = up(self.sheet["crosstalk"] * self._most)
        crosstalk = self._share, self._doubtful, handed
        self._functions.measure_pressure(n, self._area, self._most, crosstalk, *bounds[6:])

    def felt(self, bounds: "Sequence[Buffer]") -> "tuple[Buffer, Buffer]":
        """Pressure in Pa: at least its own."""
        return bounds[8], bounds[9]
