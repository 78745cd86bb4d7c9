"""From the codes of a skin's pads back to pressures, by the firmware's own arithmetic.

All taxels have one data sheet, so the firmware's calibration of one taxel measures all samples of a
stretch in one call, as it would those of one taxel. What neighbours hand on is subtracted in
as many calls as there are surroundings: so many neighbours, of which so many are measured.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from eskin_sensor_node.machine.compilation import compiled_inversion
from eskin_sensor_node.machine.data_sheet import data_sheet
from eskin_sensor_node.world.skin.skin import NO_NEIGHBOUR

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from eskin.interval import Floats
    from eskin_sensor_node.kinds.converter import Codes
    from eskin_sensor_node.kinds.pad import PadSection
    from eskin_sensor_node.kinds.settings import Companion
    from eskin_sensor_node.world.skin.skin import Indices


class Surroundings(NamedTuple):
    """Columns with as many neighbours, of which as many are measured.

    Attributes:
        neighbours: How many sit around each.
        columns: Which.
        around: The measured ones of each, ascending: neighbours × columns.
    """

    neighbours: int
    columns: Indices
    around: Indices


def surroundings(neighbours: Indices, measured: NDArray[np.bool_]) -> list[Surroundings]:
    """Group columns by their surroundings.

    Args:
        neighbours: Columns of each column's neighbours in ascending order of taxels, shape
            ``(columns, most)``: `NO_NEIGHBOUR` where there is none, ``len(measured)`` where this
            node does not sample it.
        measured: Which columns are sampled and not broken.
    """
    there = neighbours != NO_NEIGHBOUR
    known = there & np.append(measured, np.zeros(1, np.bool_))[neighbours]
    counts = np.stack([there.sum(axis=1), known.sum(axis=1)])
    found = []
    for total, some in np.unique(counts, axis=1).T.tolist():
        columns = np.flatnonzero((counts[0] == total) & (counts[1] == some))
        # Unmeasured ones to the end, without a change of order.
        order = np.argsort(~known[columns], axis=1, kind="stable")[:, :some]
        around = np.take_along_axis(neighbours[columns], order, axis=1)
        found.append(Surroundings(total, columns, around.T))
    return found


class PadColumnsInversion:
    """The firmware's calibration of a pad, for all pads of a skin.

    Args:
        taxel: Their data sheet.
        companions: What they read along, by the names of their inputs.
    """

    def __init__(self, taxel: PadSection, companions: Mapping[str, Companion]) -> None:
        self._calibrated = taxel.firmware(data_sheet(taxel, companions), compiled_inversion())
        names = [quantity for quantity, _ in self._calibrated.quantities]
        self._capacitance, self._pressure = (
            2 * names.index("capacitance"),
            2 * names.index("pressure"),
        )
        self._bounds: list[Any] = []

    def measure(self, codes: Mapping[str, Codes]) -> None:
        """Measure samples of columns × rows, as if each pad were alone.

        Args:
            codes: Of each input, columns × rows.
        """
        given: list[Any] = [
            np.ascontiguousarray(codes[name]).ravel() for name in self._calibrated.inputs
        ]
        size = given[0].size
        if not self._bounds or self._bounds[0].size != size:
            self._bounds = [np.empty(size) for _ in range(2 * len(self._calibrated.quantities))]
        self._calibrated.measure(given, size, self._bounds)
        self._shape = codes[self._calibrated.inputs[0]].shape

    def separate(self, groups: list[Surroundings]) -> None:
        """Subtract what neighbours hand on."""
        felt = self.pressure
        if not groups:
            return
        found = [self._of_group(group, *felt) for group in groups]
        for group, bounds in zip(groups, found, strict=True):
            for whole, own in zip(felt, bounds, strict=True):
                whole[group.columns] = own

    def _of_group(self, group: Surroundings, lows: Floats, highs: Floats) -> list[Floats]:
        """Bounds of the pressure of one group's columns."""
        shape = len(group.columns), self._shape[1]
        size = shape[0] * shape[1]
        own = [lows[group.columns].ravel(), highs[group.columns].ravel()]
        around = [(lows[each].ravel(), highs[each].ravel()) for each in group.around]
        bounds: list[Any] = [np.empty(0)] * len(self._bounds)
        start = self._pressure
        bounds[start - 2 : start + 2] = [np.empty(size), np.empty(size), *own]
        self._calibrated.surround(group.neighbours)
        self._calibrated.separate(size, bounds, around)
        return [each.reshape(shape) for each in own]

    @property
    def capacitance(self) -> tuple[Floats, Floats]:
        """Lower and upper bounds of the last samples in F, columns × rows."""
        return self._of(self._capacitance)

    @property
    def pressure(self) -> tuple[Floats, Floats]:
        """Bounds in Pa: what is felt, and once separated, what presses."""
        return self._of(self._pressure)

    def _of(self, place: int) -> tuple[Floats, Floats]:
        lows, highs = self._bounds[place : place + 2]
        return lows.reshape(self._shape), highs.reshape(self._shape)


def least_width(taxel: PadSection) -> float:
    """Least width, in Pa, of the pressure that any pad feels, for any parts and air.

    It holds before the interval is cut with what the data sheet allows: a pad at rest has a
    narrower one.
    """
    kelvin = max(abs(taxel.temperature_min - 20.0), abs(taxel.temperature_max - 20.0))
    percent = max(abs(taxel.humidity_min - 50.0), abs(taxel.humidity_max - 50.0))
    slopes = (
        (kelvin, taxel.permittivity_per_K, taxel.permittivity_per_K_tolerance),
        (percent, taxel.permittivity_per_percent, taxel.permittivity_per_percent_tolerance),
    )
    # The width falls with the permittivity: the greatest one, known exactly, gives the least.
    greatest = 1.0 + sum(span * abs(slope) * (1.0 + error) for span, slope, error in slopes)
    sheet = data_sheet(taxel) | {"permittivity_per_K": 0.0, "permittivity_per_percent": 0.0}
    sheet["relative_permittivity"] *= greatest
    calibrated = taxel.firmware(sheet, compiled_inversion())
    codes: Any = np.arange(1, (1 << taxel.adc_bits) - 1)
    bounds: list[Any] = [np.empty(codes.size) for _ in range(2 * len(calibrated.quantities))]
    calibrated.measure([codes], codes.size, bounds)
    lows, highs = calibrated.felt(bounds)
    widths = np.asarray(highs) - np.asarray(lows)
    return float(widths[np.isfinite(widths)].min())
