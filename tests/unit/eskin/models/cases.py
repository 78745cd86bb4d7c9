"""Every model with the range of its parameters, its truth, and how to draw boxes and members."""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from flint import arb

from eskin import models
from eskin.interval import Interval
from tests.unit.eskin.models import truth

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from numpy.random import Generator
    from numpy.typing import NDArray

    Box = dict[str, Interval]
    Point = dict[str, NDArray[np.float64]]

WIDTHS = np.array([0.0, 1e-9, 1e-3, 0.05, 0.3])
FAR = (-1.0, 1.0)
"""Marks a time of either sign, with the awkward ones among them."""


@dataclass(frozen=True)
class Case:
    call: Callable[..., Any]
    truth: Callable[..., dict[str, Any]]
    ranges: dict[str, tuple[float, float]]
    thin: frozenset[str] = frozenset()

    def evaluate(self, box: Mapping[str, Any]) -> dict[str, Interval]:
        found = self.call(**box)
        if isinstance(found, Interval):
            return {"value": found}
        return {field.name: getattr(found, field.name) for field in fields(found)}

    def exact(self, point: Point, i: int) -> dict[str, Any]:
        return self.truth({name: arb(float(value[i])) for name, value in point.items()})

    def boxes(self, generator: Generator, n: int) -> Box:
        return {name: self._draw(generator, name, n) for name in self.ranges}

    def _draw(self, generator: Generator, name: str, n: int) -> Interval:
        least, greatest = self.ranges[name]
        if (least, greatest) == FAR:
            kinds = np.stack([
                generator.uniform(-3.0, 3.0, n),
                generator.integers(-64, 64, n) / 32.0,
                generator.choice([0.0, 1e-300, 5e-324, -1e-9, 0.125], n),
                generator.uniform(0.0, 1e9, n),
            ])  # fmt: skip
            middle = kinds[generator.integers(0, 4, n), np.arange(n)]
        else:
            middle = np.exp(generator.uniform(np.log(least), np.log(greatest), n))
        if name in self.thin or name == "time":
            return Interval(middle)
        half = 0.5 * generator.choice(WIDTHS, n)
        return Interval(middle * (1.0 - half), middle * (1.0 + half))


def members(box: Box, generator: Generator) -> Point:
    """A point of each box: half of its coordinates at an end, the others anywhere."""
    point = {}
    for name, value in box.items():
        share = generator.uniform(0.0, 1.0, value.inf.shape)
        ends = generator.integers(0, 2, share.shape).astype(float)
        share = np.where(generator.random(share.shape) < 0.5, ends, share)
        inside = value.inf + share * (value.sup - value.inf)
        point[name] = np.clip(inside, value.inf, value.sup)
    return point


def encloses(inf: float, sup: float, exact: Any) -> bool:
    return not (exact < arb(float(inf)) or exact > arb(float(sup)))


CHAIN = {"minimum_capacitance": (1e-12, 1e-9), "maximum_capacitance": (1e-12, 1e-8)}
ALTERNATING = {
    **CHAIN,
    "voltage": (0.1, 100.0),
    "voltage_frequency": (1.0, 1e4),
    "frequency": (0.1, 100.0),
    "time": FAR,
}
THIN = frozenset({"voltage_frequency", "frequency"})
COIL = {
    "base_inductance": (1e-2, 2e-2),
    "inductance_change": (1e-6, 6e-3),
    "damping": (0.1, 1e3),
    "capacitance": (1e-9, 1e-5),
}
VACUUM = {"vacuum_permittivity": (8e-12, 9e-12)}
CASES = {
    "capacitance": Case(
        models.capacitance,
        truth.capacitance,
        VACUUM
        | {"relative_permittivity": (1.0, 80.0), "area": (1e-8, 1e-2), "distance": (1e-6, 1e-1)},
    ),
    "moving_plate": Case(
        models.moving_plate,
        truth.moving_plate,
        VACUUM
        | {
            "area": (1e-8, 1e-2),
            "minimum_distance": (1e-4, 1e-2),
            "maximum_distance": (1e-3, 1e-1),
            "frequency": (0.1, 50.0),
            "time": FAR,
        },
        frozenset({"frequency"}),
    ),
    "touch": Case(
        models.touch,
        truth.touch,
        VACUUM
        | {
            "minimum_area": (1e-6, 1e-4),
            "maximum_area": (1e-5, 1e-3),
            "distance": (1e-4, 1e-2),
            "voltage": (0.1, 10.0),
            "frequency": (0.1, 50.0),
            "time": FAR,
        },
        frozenset({"frequency"}),
    ),
    "touch_of_area": Case(
        models.touch_of_area,
        truth.touch_of_area,
        VACUUM | {"area": (1e-12, 1.0), "distance": (1e-4, 1e-2), "voltage": (1e-3, 1e3)},
    ),
    "coil_current": Case(
        models.coil_current,
        truth.coil_current,
        {
            "voltage": (1e-3, 10.0),
            "resistance": (1e-3, 1e4),
            "inductance": (1e-6, 1.0),
            "frequency": (1.0, 1e6),
        },
    ),
    "lc_frequency": Case(
        models.lc_frequency,
        truth.lc_frequency,
        {"inductance": (1e-9, 1.0), "capacitance": (1e-15, 1e-3)},
    ),
    "rc_frequency": Case(
        models.rc_frequency,
        truth.rc_frequency,
        {"resistance": (1.0, 1e9), "capacitance": (1e-15, 1e-3)},
    ),
    "rc_frequency_paper": Case(
        models.rc_frequency_paper,
        truth.rc_frequency_paper,
        {"resistance": (1.0, 1e9), "capacitance": (1e-15, 1e-3)},
    ),
    "harmonic_capacitance": Case(
        models.harmonic_capacitance,
        truth.harmonic_capacitance,
        {**CHAIN, "frequency": (0.1, 100.0), "time": FAR},
        frozenset({"frequency"}),
    ),
    "capacitive_chain": Case(
        models.capacitive_chain,
        truth.capacitive_chain,
        {
            **CHAIN,
            "resistance": (10.0, 1e6),
            "transconductance": (1e-6, 1e-2),
            "frequency": (0.1, 100.0),
            "time": FAR,
        },
        frozenset({"frequency"}),
    ),
    "chain_current": Case(
        models.chain_current,
        truth.chain_current,
        {**CHAIN, "transconductance": (1e-6, 1e-2), "frequency": (0.1, 100.0), "time": FAR},
        frozenset({"frequency"}),
    ),
    "alternating_capacitance": Case(
        models.alternating_capacitance,
        truth.harmonic_capacitance,
        {**CHAIN, "frequency": (0.1, 100.0), "time": FAR},
        frozenset({"frequency"}),
    ),
    "alternating_capacitance_paper": Case(
        models.alternating_capacitance_paper,
        truth.alternating_capacitance_paper,
        {**CHAIN, "frequency": (0.1, 100.0), "time": FAR},
        frozenset({"frequency"}),
    ),
    "alternating_current": Case(
        models.alternating_current,
        partial(truth.alternating_current, raised_swing=True, moving=True),
        ALTERNATING,
        THIN,
    ),
    "alternating_current_of_eq_7": Case(
        partial(models.alternating_current, swing=models.Swing.PAPER),
        partial(truth.alternating_current, raised_swing=False, moving=True),
        ALTERNATING,
        THIN,
    ),
    "alternating_current_paper": Case(
        models.alternating_current_paper,
        partial(truth.alternating_current, raised_swing=False, moving=False),
        ALTERNATING,
        THIN,
    ),
    "proximity": Case(
        models.proximity,
        truth.proximity,
        {
            **COIL,
            "mean_distance": (1e-2, 1e-1),
            "distance_amplitude": (1e-5, 5e-3),
            "frequency": (0.1, 50.0),
            "time": FAR,
        },
        frozenset({"frequency"}),
    ),
    "proximity_at": Case(
        models.proximity_at, truth.proximity_at, {**COIL, "distance": (1e-9, 10.0)}
    ),
    "resonance": Case(
        models.resonance,
        truth.resonance,
        {
            "voltage": (0.1, 10.0),
            "resistance": (0.1, 100.0),
            "capacitance": (1e-7, 1e-5),
            "source_frequency": (300.0, 5e3),
            "minimum_inductance": (3e-3, 1e-2),
            "maximum_inductance": (5e-3, 3e-2),
            "frequency": (0.1, 50.0),
            "time": FAR,
        },
        frozenset({"frequency"}),
    ),
    "coil_energy": Case(
        models.coil_energy,
        truth.coil_energy,
        {
            "voltage": (1e-3, 10.0),
            "loss_resistance": (0.1, 1e3),
            "inductance": (1e-6, 1.0),
            "time": (1e-9, 1.0),
        },
    ),
    "energy_flow": Case(
        models.energy_flow,
        truth.energy_flow,
        {
            "voltage": (0.1, 10.0),
            "switch_resistance": (1e-3, 1e2),
            "coil_resistance": (0.1, 100.0),
            "inductance": (1e-4, 1e-1),
            "capacitor_resistance": (1.0, 1e3),
            "capacitance": (1e-9, 1e-4),
            "time": (1e-7, 1.0),
        },
    ),
}
