"""Each model with its formula, and how its boxes are drawn."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from flint import arb

from eskin import models
from eskin.interval import Interval
from eskin.models import icm
from tests.boxes.draw import draw
from tests.eskin.models.cases import CASES, Case
from tests.eskin.models.icm import reference

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.random import Generator

    from tests.boxes.draw import Member

SOURCE = {"amplitude": (0.1, 10.0), "frequency": (0.1, 1e4), "phase": (1e-3, 7.0)}


def _since_start(p: Member) -> bool:
    return bool(p["time"] > 0)


def _current(p: Member) -> dict[str, Any]:
    if not _since_start(p):
        return {"value": arb(0)}
    tau = p["inductance"] / p["coil_resistance"]
    h = reference.response(p["frequency"], tau, p["phase"], p["time"])
    return {"value": p["amplitude"] * h / p["coil_resistance"]}


def _voltage(p: Member) -> dict[str, Any]:
    if not _since_start(p):
        return {"value": arb(0)}
    tau = p["capacitor_resistance"] * p["capacitance"]
    return {
        "value": p["amplitude"] * reference.response(p["frequency"], tau, p["phase"], p["time"])
    }


def _source(p: Member) -> dict[str, Any]:
    if p["time"] < 0:
        return {"value": arb(0)}
    angle = 2 * p["frequency"] * p["time"] + p["phase"] / arb.pi()
    return {"value": p["amplitude"] * angle.sin_pi()}


def _oscillation(p: Member) -> dict[str, Any]:
    return {"value": p["voltage"] * (2 * p["frequency"] * p["time"]).sin_pi()}


def _oscillation_model(**given: Any) -> Interval:
    return models.oscillation_paper(given.pop("time"), **given)


EVERY = CASES | {
    "oscillation_paper": Case(
        _oscillation_model,
        _oscillation,
        {"voltage": (0.1, 10.0), "frequency": (0.1, 1e4), "time": (1e-3, 1e3)},
    ),
    "magfes_current": Case(
        icm.magfes_current,
        _current,
        SOURCE | {"coil_resistance": (1.0, 1e4), "inductance": (1e-4, 1.0), "time": (1e-6, 0.1)},
        frozenset({"time"}),
    ),
    "ecfes_voltage": Case(
        icm.ecfes_voltage,
        _voltage,
        SOURCE
        | {"capacitor_resistance": (1.0, 1e4), "capacitance": (1e-9, 1e-4), "time": (1e-6, 0.1)},
        frozenset({"time"}),
    ),
    "source_voltage": Case(
        icm.source_voltage, _source, SOURCE | {"time": (1e-6, 0.1)}, frozenset({"time"})
    ),
}
"""By name; `oscillation` and the Euler form take whole curves, and have tests of their own."""
THIN = {
    "alternating_current": {"time", "frequency", "voltage_frequency"},
    "alternating_current_of_eq_7": {"time", "frequency", "voltage_frequency"},
    "alternating_current_paper": {"time", "frequency", "voltage_frequency"},
    "magfes_current": {"time"},
    "ecfes_voltage": {"time"},
    "source_voltage": {"time"},
}
"""Parameters that a model needs as plain numbers."""
SINCE_START = frozenset({"coil_energy", "energy_flow"})
"""Models whose time is not negative."""


def boxes(name: str, generator: Generator, n: int) -> Mapping[str, Interval]:
    """``n`` boxes of a model's parameters."""
    case = EVERY[name]
    drawn = {}
    for parameter, ordinary in case.ranges.items():
        found = draw(generator, parameter, ordinary, n, thin=parameter in THIN.get(name, set()))
        if parameter == "time" and name in SINCE_START:
            found = abs(found)
        drawn[parameter] = found
    if name == "proximity":  # the amplitude is at most the mean distance
        most = drawn["mean_distance"].inf
        amplitude = drawn["distance_amplitude"]
        drawn["distance_amplitude"] = Interval(
            np.minimum(amplitude.inf, most), np.minimum(amplitude.sup, most)
        )
    return drawn
