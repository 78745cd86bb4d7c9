"""Harvest from touches: piezoelectric from changes of force, triboelectric from separations.

Piezoelectric: a change of force ΔF moves the charge ``d33·g·ΔF`` on a layer of capacitance C; a
circuit that empties the layer at each extremum takes ``½·(d33·g·ΔF)²/C`` each time. Source:
Lefeuvre, Badel, Richard, Guyomar, "Piezoelectric energy harvesting device optimization by
synchronous electric charge extraction", J. Intell. Mater. Syst. Struct. 16 (2005) 865–876.

Triboelectric: layers with surface charge σ that touched over S and separate to x have
``Q = σ·S·x/(d0 + x)`` on short circuit and ``V = σ·x/ε0`` on open circuit; emptied once apart they
give ``½·Q·V``. Source: Niu et al., "Theoretical study of contact-mode triboelectric nanogenerators
as an effective power source", Energy Environ. Sci. 6 (2013) 3576–3583.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, TypeVar

import numpy as np

from eskin.constants import VACUUM_PERMITTIVITY
from eskin.interval import Interval
from eskin_sensor_node.kinds.parameters import TRUE_VACUUM_PERMITTIVITY, draw_part
from eskin_sensor_node.world.scenario import Stage, read_scenario
from eskin_sensor_node.world.scenario.fit import Staged

if TYPE_CHECKING:
    from collections.abc import Sequence

    from eskin.interval import Floats
    from eskin_sensor_node.kinds.generator import ColumnGenerator
    from eskin_sensor_node.kinds.settings import TaxelSection
    from eskin_sensor_node.settings import EnergySection

Value = TypeVar("Value", float, Interval)

_GRID_S: Final = 0.01
"""Between two looks at the touches: a tap lasts a tenth of a second."""


@dataclass(slots=True)
class Touches:
    """What touches did, over all taxels.

    Attributes:
        swings: Sum of the squared changes of force between extrema, N².
        released: Sum of the areas that touched and separated, m².
    """

    swings: float = 0.0
    released: float = 0.0


class _Swings:
    """Extrema of some forces, and the greatest area of each contact."""

    def __init__(self, n: int) -> None:
        self._turned = np.zeros(n)
        self._last = np.zeros(n)
        self._rising = np.ones(n, dtype=np.bool_)
        self._covered = np.zeros(n)

    def take(self, force: Floats, area: Floats, touches: Touches) -> None:
        """Take the present forces in N and areas in m²."""
        turns = np.where(self._rising, force < self._last, force > self._last)
        swing = np.where(turns, self._last - self._turned, 0.0)
        touches.swings += float(swing @ swing)
        self._turned = np.where(turns, self._last, self._turned)
        self._rising ^= turns
        self._last = force
        gone = area <= 0.0
        touches.released += float(np.sum(self._covered[gone]))
        self._covered = np.where(gone, 0.0, np.maximum(self._covered, area))


class Harvester:
    """Follows the true touches of a node's pads; other taxels give nothing.

    Args:
        taxels: The node's.
        origin: s of the scenario at which it begins.
    """

    def __init__(self, taxels: Sequence[TaxelSection], origin: float = 0.0) -> None:
        pads: dict[str, list[str]] = {}
        for taxel in taxels:
            if isinstance(taxel, Staged) and taxel.pressed:
                pads.setdefault(taxel.scenario, []).append(taxel.place)
        self._stages = [Stage(read_scenario(name), places) for name, places in pads.items()]
        self._swings = [_Swings(len(stage.places)) for stage in self._stages]
        self._step = round(origin / _GRID_S)

    def touches(self, seconds: float) -> Touches:
        """What happened since the last call, up to a time in s."""
        found = Touches()
        end = int(seconds / _GRID_S)
        times = np.arange(self._step, end, dtype=np.float64) * _GRID_S
        self._step = max(self._step, end)
        if len(times):
            for stage, swings in zip(self._stages, self._swings, strict=True):
                stimulus = stage.stimulus(times)
                cell = stage.skin.cell_area
                for k in range(len(times)):
                    swings.take(
                        stimulus.pressure[:, k] * cell, stimulus.covered[:, k] * cell, found
                    )
        return found


class Layers:
    """True layers of one node: touches to energy in the supercapacitor."""

    def __init__(self, sheet: EnergySection, random: ColumnGenerator) -> None:
        drawn = {name: draw_part(random, *part).item() for name, part in _parts(sheet).items()}
        drawn["permittivity"], drawn["gain"] = TRUE_VACUUM_PERMITTIVITY, sheet.piezo_gain
        self._piezo = drawn["efficiency"] * _per_swing(drawn)
        self._tribo = drawn["efficiency"] * _per_area(drawn)

    def energy(self, touches: Touches) -> float:
        """Harvested energy in J."""
        return self._piezo * touches.swings + self._tribo * touches.released


def harvest_bounds(sheet: EnergySection, touches: Touches) -> dict[str, Interval]:
    """Energies in J that touches give, as the data sheet bounds them."""
    parts = {name: Interval.relative(*part) for name, part in _parts(sheet).items()}
    parts |= {"permittivity": VACUUM_PERMITTIVITY, "gain": Interval(sheet.piezo_gain)}
    lowest = {name: Interval(part.inf) for name, part in parts.items()}
    highest = {name: Interval(part.sup) for name, part in parts.items()}
    # Both rise with the charges and the gap, and fall with what they are divided by.
    for name in ("capacitance", "thickness", "permittivity"):
        lowest[name], highest[name] = highest[name], lowest[name]
    found = {
        "piezoelectric": (_per_swing, touches.swings),
        "triboelectric": (_per_area, touches.released),
    }
    return {
        name: Interval(
            (each(lowest) * lowest["efficiency"] * Interval(amount)).inf,
            (each(highest) * highest["efficiency"] * Interval(amount)).sup,
        )
        for name, (each, amount) in found.items()
    }


def _parts(sheet: EnergySection) -> dict[str, tuple[float, float]]:
    return {
        "coefficient": (sheet.piezo_coefficient, sheet.piezo_tolerance),
        "capacitance": (sheet.piezo_capacitance, sheet.piezo_tolerance),
        "charge": (sheet.tribo_charge, sheet.tribo_tolerance),
        "gap": (sheet.tribo_gap_m, sheet.tribo_tolerance),
        "thickness": (sheet.tribo_thickness_m, sheet.tribo_tolerance),
        "efficiency": (sheet.harvest_efficiency, sheet.harvest_efficiency_tolerance),
    }


def _per_swing(parts: dict[str, Value]) -> Value:
    """J for each N²."""
    charge = parts["coefficient"] * parts["gain"]
    return charge * charge / parts["capacitance"] * 0.5


def _per_area(parts: dict[str, Value]) -> Value:
    """J for each m²: ``½·σ²·x²/(ε0·(d0 + x))``."""
    charge, gap = parts["charge"], parts["gap"]
    below = parts["permittivity"] * (parts["thickness"] + gap)
    return charge * gap * (charge * gap) / below * 0.5
