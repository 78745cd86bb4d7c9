"""Measurements of a skin's taxels, and the contacts that they enclose."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from eskin.interval import Interval
from eskin_sensor_node.kinds.registry import build_frontend
from eskin_sensor_node.machine.inversion import Inversion
from eskin_sensor_node.tools.dataset.pad_inversion import PadInversion
from eskin_sensor_node.world.skin import unmix

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from eskin.interval import Floats
    from eskin_sensor_node.kinds.generator import ColumnGenerator
    from eskin_sensor_node.kinds.pad import PadSection
    from eskin_sensor_node.kinds.settings import TaxelSection
    from eskin_sensor_node.world.skin.skin import Indices


class Chains:
    """The measuring chains of some equal taxels, a column each.

    Args:
        taxel: Their data sheet.
        random: Draws their true parts, then their noise.
    """

    def __init__(self, taxel: TaxelSection, random: ColumnGenerator) -> None:
        self._frontend = build_frontend(taxel, random)
        self._inversion = Inversion(taxel)
        self._random = random

    def measure(
        self, sensed: Mapping[str, Floats], instants: NDArray[np.int64]
    ) -> tuple[dict[str, Floats], dict[str, Interval]]:
        """Run all chains on what the sensors give at instants in ns, each quantity taxels × times.

        Returns:
            The quantities that come to be in the chains, and the intervals.
        """
        self._random.begin(0, instants)
        done = self._frontend.digitise(sensed, self._random)
        return done.truth, self._inversion.measure(done.codes)


class SkinInversion:
    """Infers the contacts of a whole skin of equal pads.

    Args:
        taxel: Their data sheet.
        neighbours: Table of neighbours.
        crosstalk: The skin's greatest coefficient.
        broken: Taxels whose capacitance has other causes: stuck, dead or wet ones.
        worn: Taxels that are no longer as the data sheet has them.
    """

    def __init__(
        self,
        taxel: PadSection,
        neighbours: Indices,
        *,
        crosstalk: float,
        broken: Sequence[int],
        worn: Sequence[int] = (),
    ) -> None:
        self._inversion = PadInversion(taxel)
        self._neighbours = neighbours
        self._crosstalk = crosstalk
        self._most = taxel.pressure_max_Pa
        self._broken, self._worn = sorted({*broken}), sorted({*worn})

    def infer(
        self, capacitance: Interval, temperature: Interval, humidity: Interval
    ) -> dict[str, Interval]:
        """Pressure in Pa, contact area in m², both distances in m, taxels × times."""
        distance = self._inversion.plate_distance(capacitance, temperature, humidity)
        own = unmix(
            self._inversion.felt(distance),
            self._neighbours,
            bound=self._crosstalk,
            most=self._most,
            broken=[*self._broken, *self._worn],
        )
        found = {"plate_distance": self._believed(distance)} | self._inversion.quantities(own)
        found["contact_distance"] = _unknown(found["contact_distance"], self._worn)
        return found

    def _believed(self, distance: Interval) -> Interval:
        """Limit a broken taxel to its data sheet, if it is not worn, too."""
        lo, hi = distance.inf.copy(), distance.sup.copy()
        lo[self._broken] = self._inversion.stated_distance.inf
        hi[self._broken] = self._inversion.stated_distance.sup
        both = [row for row in self._broken if row in self._worn]
        return _unknown(Interval(lo, hi), both)


def _unknown(values: Interval, rows: Sequence[int]) -> Interval:
    """Nothing is known of some taxels."""
    lo, hi = values.inf.copy(), values.sup.copy()
    lo[list(rows)], hi[list(rows)] = -np.inf, np.inf
    return Interval(lo, hi)
