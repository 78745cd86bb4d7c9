"""Measurements of a skin's taxels, and the contacts that they enclose."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from eskin.interval import Interval
from eskin_sensor_node.kinds.pad.inversion import PadInversion
from eskin_sensor_node.kinds.registry import build_frontend
from eskin_sensor_node.machine.inversion import Inversion
from eskin_sensor_node.world.skin import unmix

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from eskin.interval import Floats
    from eskin_sensor_node.kinds.pad.settings import PadSection
    from eskin_sensor_node.kinds.settings import TaxelSection
    from eskin_sensor_node.world.skin.skin import Indices


class Chains:
    """The measuring chains of some equal taxels, each with its true parts and its noise.

    Args:
        taxels: Their data sheets.
        parts: Draw the true parts, one generator for each.
        noises: Draw the noise, likewise.
    """

    def __init__(
        self,
        taxels: Sequence[TaxelSection],
        parts: Sequence[np.random.Generator],
        noises: Sequence[np.random.Generator],
    ) -> None:
        self._frontends = [
            build_frontend(taxel, random) for taxel, random in zip(taxels, parts, strict=True)
        ]
        # Equal data sheets have equal inversions.
        self._inversion = Inversion(taxels[0])
        self._noises = noises

    def measure(
        self, sensed: Mapping[str, Floats]
    ) -> tuple[dict[str, Floats], dict[str, Interval]]:
        """Run all chains on what the sensors give, each quantity taxels × times.

        Returns:
            The quantities that come to be in the chains, and the intervals.
        """
        shape = next(iter(sensed.values())).shape
        done = [
            frontend.digitise({name: rows[number] for name, rows in sensed.items()}, random)
            for number, (frontend, random) in enumerate(
                zip(self._frontends, self._noises, strict=True)
            )
        ]
        truth = {name: np.stack([each.truth[name] for each in done]) for name in done[0].truth}
        codes = {
            name: np.concatenate([each.codes[name] for each in done]) for name in done[0].codes
        }
        measured = self._inversion.measure(codes)
        return truth, {name: values.reshape(shape) for name, values in measured.items()}


class SkinInversion:
    """Infers the contacts of a whole skin of equal pads.

    Args:
        taxel: Their data sheet.
        neighbours: Table of neighbours.
        crosstalk: The skin's greatest coefficient.
        broken: Taxels that are not to be believed.
    """

    def __init__(
        self, taxel: PadSection, neighbours: Indices, *, crosstalk: float, broken: Sequence[int]
    ) -> None:
        self._inversion = PadInversion(taxel)
        self._neighbours = neighbours
        self._crosstalk = crosstalk
        self._most = taxel.pressure_max_Pa
        self._broken = list(broken)

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
            broken=self._broken,
        )
        return {"plate_distance": self._believed(distance)} | self._inversion.quantities(own)

    def _believed(self, distance: Interval) -> Interval:
        """Limit a broken taxel to its data sheet."""
        lo, hi = distance.inf.copy(), distance.sup.copy()
        lo[self._broken] = self._inversion.stated_distance.inf
        hi[self._broken] = self._inversion.stated_distance.sup
        return Interval(lo, hi)
