"""Every model: how to call it, what its parameters may be, and its formula."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from flint import arb

from eskin import models
from eskin.constants import VACUUM_PERMITTIVITY
from eskin.interval import Interval
from eskin.models import formulas, icm
from tests.robustness.boxes.draw import Kind, draw
from tests.unit.eskin.models import truth

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from numpy.random import Generator

    Formula = Callable[[Mapping[str, Any]], dict[str, Any]]

_PLUS, _ZERO, _ANY = Kind.POSITIVE, Kind.NOT_NEGATIVE, Kind.FINITE


@dataclass(frozen=True)
class Range:
    """What one parameter may be."""

    kind: Kind
    typical: tuple[float, float]
    thin: bool = False
    extent: tuple[float, float] = (1e-40, 1e40)


@dataclass(frozen=True)
class Case:
    """One model.

    Attributes:
        call: The model.
        formula: Its results at one point.
        ranges: Its parameters.
        order: Pairs of parameters of which the first must be less than the second.
        hard: Whether a search for inner optima pays.
    """

    call: Callable[..., Any]
    formula: Formula
    ranges: dict[str, Range]
    order: tuple[tuple[str, str], ...] = ()
    hard: bool = False

    def boxes(self, generator: Generator, n: int) -> dict[str, Interval]:
        """Draw boxes of all parameters."""
        box = {
            name: draw(generator, r.kind, r.typical, n, thin=r.thin, extent=r.extent)
            for name, r in self.ranges.items()
        }
        for smaller, greater in self.order:
            box[smaller] = _less(generator, box[smaller], box[greater])
        return box

    def evaluate(self, box: Mapping[str, Interval]) -> dict[str, Interval]:
        """All results over the boxes."""
        thin = {name for name, r in self.ranges.items() if r.thin}
        found = self.call(**{name: v.inf if name in thin else v for name, v in box.items()})
        if isinstance(found, Interval):
            return {"value": found}
        return {field.name: getattr(found, field.name) for field in dataclasses.fields(found)}


def _less(generator: Generator, smaller: Interval, greater: Interval) -> Interval:
    """What lies below another parameter: scaled down where it does not."""
    beyond = smaller.sup >= greater.inf
    share = generator.choice([0.0, 1e-9, 0.5, 0.999999, 1.0 - 2.0**-52], smaller.sup.shape)
    most = np.where(share * greater.inf >= 1e-40, share * greater.inf, 0.0)
    thin = np.where(generator.random(most.shape) < 0.5, most, 0.0)
    return Interval(np.where(beyond, thin, smaller.inf), np.where(beyond, most, smaller.sup))


def _response(p: Mapping[str, Any], tau: Any) -> Any:
    """``h`` of eq. 26 and 27: from the settled swing, what is left of its start."""
    omega = 2 * arb.pi() * p["frequency"]
    x, a = omega * tau, omega * p["time"]
    settled = (a + p["phase"]).sin() - x * (a + p["phase"]).cos()
    start = p["phase"].sin() - x * p["phase"].cos()
    return (settled - start * (-p["time"] / tau).exp()) / (1 + x * x)


def _voltage(p: Mapping[str, Any]) -> dict[str, Any]:
    if p["time"] <= 0:
        return {"value": arb(0)}
    return {"value": p["amplitude"] * _response(p, p["capacitor_resistance"] * p["capacitance"])}


def _current(p: Mapping[str, Any]) -> dict[str, Any]:
    if p["time"] <= 0:
        return {"value": arb(0)}
    r = p["coil_resistance"]
    return {"value": p["amplitude"] / r * _response(p, p["inductance"] / r)}


def _source(p: Mapping[str, Any]) -> dict[str, Any]:
    if p["time"] < 0:
        return {"value": arb(0)}
    angle = 2 * arb.pi() * p["frequency"] * p["time"] + p["phase"]
    return {"value": p["amplitude"] * angle.sin()}


def _oscillation_paper(p: Mapping[str, Any]) -> dict[str, Any]:
    return {"value": p["voltage"] * truth.sine(p)}


def _two_steps(**given: Any) -> Interval:
    """`eskin.models.oscillation` at the end of two steps: its phase is a sum over them."""
    first, second = given["first"], given["second"]
    out_inf, out_sup = np.empty((2, first.inf.size))
    for i in range(first.inf.size):
        start, middle = given["start"][i], given["middle"][i]
        times = np.sort([start, middle, given["end"][i]])
        if not np.all(np.diff(times) > 0.0):
            times = np.array([0.0, 1.0, 2.0])
        f = Interval([first.inf[i], second.inf[i]], [first.sup[i], second.sup[i]])
        v = Interval(given["voltage"].inf[i], given["voltage"].sup[i])
        found = models.oscillation(times, voltage=v, frequency=f)
        out_inf[i], out_sup[i] = found.inf[-1], found.sup[-1]
    return Interval(out_inf, out_sup)


def _two_steps_formula(p: Mapping[str, Any]) -> dict[str, Any]:
    times = sorted((p["start"], p["middle"], p["end"]), key=lambda t: float(t.mid()))
    if not (times[0] < times[1] < times[2]):
        times = [arb(0), arb(1), arb(2)]
    turns = p["first"] * (times[1] - times[0]) + p["second"] * (times[2] - times[1])
    return {"value": p["voltage"] * (2 * turns).sin_pi()}


def _plain_capacitance(p: Mapping[str, Any]) -> dict[str, Any]:
    permittivity = arb(float(VACUUM_PERMITTIVITY.mid))
    return {"value": permittivity * p["relative_permittivity"] * p["area"] / p["distance"]}


def _plain_response(p: Mapping[str, Any]) -> dict[str, Any]:
    frequency = p["angular_frequency"] / (2 * arb.pi())
    return {"value": _response({**p, "frequency": frequency}, p["time_constant"])}


def _only(formula: Formula, name: str, given: Mapping[str, Any]) -> dict[str, Any]:
    return {"value": formula(given)[name]}


def _plain_inductance(p: Mapping[str, Any]) -> dict[str, Any]:
    return {"value": truth.proximity_at({**p, "capacitance": arb(1)})["inductance"]}


def _plain_energy(p: Mapping[str, Any]) -> dict[str, Any]:
    return truth.coil_energy({**p, "loss_resistance": p["resistance"]})


_TIME: Final = Range(_ANY, (1e-4, 1e4))
_THIN_TIME: Final = dataclasses.replace(_TIME, thin=True)
_FREQUENCY: Final = Range(_ZERO, (1e-2, 1e4))
_THIN_FREQUENCY: Final = dataclasses.replace(_FREQUENCY, thin=True)
# Together they stay below the greatest number of periods that `oscillation` takes, 1e40.
_STEP_TIME: Final = Range(_ANY, (1e-4, 1e4), thin=True, extent=(1e-19, 1e19))
_STEP_FREQUENCY: Final = Range(_ZERO, (1e-2, 1e4), extent=(1e-19, 1e19))
_VOLTAGE: Final = Range(_ZERO, (1e-3, 1e3))
_RESISTANCE: Final = Range(_PLUS, (1e-3, 1e6))
_CAPACITANCE: Final = Range(_PLUS, (1e-13, 1e-3))
_INDUCTANCE: Final = Range(_PLUS, (1e-6, 10.0))
_LENGTH: Final = Range(_PLUS, (1e-6, 1.0))
_PERMITTIVITY: Final = Range(_PLUS, (1.0, 80.0))
_VACUUM: Final = Range(_PLUS, (8e-12, 9e-12))
_PLATE: Final = {"vacuum_permittivity": _VACUUM, "relative_permittivity": _PERMITTIVITY}
_SWING: Final = {"frequency": _FREQUENCY, "time": _TIME}
_ENDS: Final = {"minimum_capacitance": _CAPACITANCE, "maximum_capacitance": _CAPACITANCE}
_COIL: Final = {
    "base_inductance": _INDUCTANCE,
    "inductance_change": Range(_ZERO, (1e-6, 1.0)),
    "damping": Range(_ZERO, (1e-1, 1e3)),
    "capacitance": _CAPACITANCE,
}
_BELOW_BASE: Final = (("inductance_change", "base_inductance"),)
_ALTERNATING: Final = {
    **_ENDS,
    "voltage": _VOLTAGE,
    "voltage_frequency": _THIN_FREQUENCY,
    "frequency": _THIN_FREQUENCY,
    "time": _THIN_TIME,
}
_SOURCE: Final = {
    "amplitude": Range(_ANY, (1e-3, 1e3)),
    "frequency": _FREQUENCY,
    "phase": Range(_ANY, (1e-2, 1e2)),
    "time": _THIN_TIME,
}
_VOLTAGE_BRANCH: Final = {
    **_SOURCE,
    "capacitor_resistance": _RESISTANCE,
    "capacitance": _CAPACITANCE,
}
_CURRENT_BRANCH: Final = {**_SOURCE, "coil_resistance": _RESISTANCE, "inductance": _INDUCTANCE}


def _thin_source(ranges: Mapping[str, Range]) -> dict[str, Range]:
    """The same with a single frequency and phase: other kernels, other proofs."""
    return {
        name: dataclasses.replace(r, thin=True) if name in ("frequency", "phase") else r
        for name, r in ranges.items()
    }


def _flow(kind: Kind, least: float, greatest: float) -> Range:
    return Range(kind, (least, greatest), extent=(1e-24, 1e24))


_MODEST: Final = (1e-6, 1e6)
_PLAIN: Final = Range(_PLUS, (1e-3, 1e3), extent=_MODEST)

CASES: Final = {
    "capacitance": Case(
        models.capacitance,
        truth.capacitance,
        {**_PLATE, "area": _LENGTH, "distance": _LENGTH},
    ),
    "moving_plate": Case(
        models.moving_plate,
        truth.moving_plate,
        {
            **_PLATE,
            "area": _LENGTH,
            "minimum_distance": _LENGTH,
            "maximum_distance": _LENGTH,
            **_SWING,
        },
    ),
    "touch": Case(
        models.touch,
        truth.touch,
        {
            **_PLATE,
            "minimum_area": _LENGTH,
            "maximum_area": _LENGTH,
            "distance": _LENGTH,
            "voltage": _VOLTAGE,
            **_SWING,
        },
    ),
    "touch_of_area": Case(
        models.touch_of_area,
        truth.touch_of_area,
        {
            **_PLATE,
            "area": Range(_ZERO, (1e-6, 1.0)),
            "distance": _LENGTH,
            "voltage": _VOLTAGE,
        },
    ),
    "coil_current": Case(
        models.coil_current,
        truth.coil_current,
        {
            "voltage": _VOLTAGE,
            "resistance": _RESISTANCE,
            "inductance": _INDUCTANCE,
            "frequency": _FREQUENCY,
        },
    ),
    "lc_frequency": Case(
        models.lc_frequency,
        truth.lc_frequency,
        {"inductance": _INDUCTANCE, "capacitance": _CAPACITANCE},
    ),
    "rc_frequency": Case(
        models.rc_frequency,
        truth.rc_frequency,
        {"resistance": _RESISTANCE, "capacitance": _CAPACITANCE},
    ),
    "rc_frequency_paper": Case(
        models.rc_frequency_paper,
        truth.rc_frequency_paper,
        {"resistance": _RESISTANCE, "capacitance": _CAPACITANCE},
    ),
    "harmonic_capacitance": Case(
        models.harmonic_capacitance, truth.harmonic_capacitance, {**_ENDS, **_SWING}
    ),
    "capacitive_chain": Case(
        models.capacitive_chain,
        truth.capacitive_chain,
        {**_ENDS, "resistance": _RESISTANCE, "transconductance": _LENGTH, **_SWING},
    ),
    "chain_current": Case(
        models.chain_current,
        truth.chain_current,
        {**_ENDS, "transconductance": _LENGTH, **_SWING},
    ),
    "alternating_capacitance": Case(
        models.alternating_capacitance, truth.harmonic_capacitance, {**_ENDS, **_SWING}
    ),
    "alternating_capacitance_paper": Case(
        models.alternating_capacitance_paper,
        truth.alternating_capacitance_paper,
        {**_ENDS, **_SWING},
    ),
    "alternating_current": Case(
        models.alternating_current,
        partial(truth.alternating_current, raised_swing=True, moving=True),
        _ALTERNATING,
    ),
    "alternating_current (eq. 7)": Case(
        partial(models.alternating_current, swing=models.Swing.PAPER),
        partial(truth.alternating_current, raised_swing=False, moving=True),
        _ALTERNATING,
    ),
    "alternating_current_paper": Case(
        models.alternating_current_paper,
        partial(truth.alternating_current, raised_swing=False, moving=False),
        _ALTERNATING,
    ),
    "oscillation": Case(
        _two_steps,
        _two_steps_formula,
        {
            "voltage": _VOLTAGE,
            "first": _STEP_FREQUENCY,
            "second": _STEP_FREQUENCY,
            "start": _STEP_TIME,
            "middle": _STEP_TIME,
            "end": _STEP_TIME,
        },
    ),
    "oscillation_paper": Case(
        models.oscillation_paper, _oscillation_paper, {"voltage": _VOLTAGE, **_SWING}
    ),
    "proximity": Case(
        models.proximity,
        truth.proximity,
        {
            **_COIL,
            "mean_distance": _LENGTH,
            "distance_amplitude": Range(_ZERO, (1e-6, 1e-1)),
            **_SWING,
        },
        (*_BELOW_BASE, ("distance_amplitude", "mean_distance")),
    ),
    "proximity_at": Case(
        models.proximity_at,
        truth.proximity_at,
        {**_COIL, "distance": Range(_ZERO, (1e-6, 1.0))},
        _BELOW_BASE,
    ),
    "resonance": Case(
        models.resonance,
        truth.resonance,
        {
            "voltage": _VOLTAGE,
            "resistance": _RESISTANCE,
            "capacitance": _CAPACITANCE,
            "source_frequency": Range(_PLUS, (1.0, 1e5)),
            "minimum_inductance": _INDUCTANCE,
            "maximum_inductance": _INDUCTANCE,
            **_SWING,
        },
        hard=True,
    ),
    "coil_energy": Case(
        models.coil_energy,
        truth.coil_energy,
        {
            "voltage": _VOLTAGE,
            "loss_resistance": _RESISTANCE,
            "inductance": _INDUCTANCE,
            "time": Range(_ZERO, (1e-6, 1.0)),
        },
    ),
    "energy_flow": Case(
        models.energy_flow,
        truth.energy_flow,
        {
            "voltage": _flow(_ZERO, 0.1, 10.0),
            "switch_resistance": _flow(_PLUS, 1e-3, 1e2),
            "coil_resistance": _flow(_PLUS, 0.1, 1e2),
            "inductance": _flow(_PLUS, 1e-4, 1e-1),
            "capacitor_resistance": _flow(_PLUS, 1.0, 1e3),
            "capacitance": _flow(_PLUS, 1e-9, 1e-4),
            "time": _flow(_ZERO, 1e-7, 1.0),
        },
        hard=True,
    ),
    "icm.source_voltage": Case(icm.source_voltage, _source, _SOURCE),
    "icm.ecfes_voltage": Case(icm.ecfes_voltage, _voltage, _VOLTAGE_BRANCH, hard=True),
    "icm.magfes_current": Case(icm.magfes_current, _current, _CURRENT_BRANCH, hard=True),
    "icm.ecfes_voltage (thin source)": Case(
        icm.ecfes_voltage, _voltage, _thin_source(_VOLTAGE_BRANCH), hard=True
    ),
    "icm.magfes_current (thin source)": Case(
        icm.magfes_current, _current, _thin_source(_CURRENT_BRANCH), hard=True
    ),
    "formulas.capacitance": Case(
        formulas.capacitance,
        _plain_capacitance,
        {"relative_permittivity": _PERMITTIVITY, "area": _LENGTH, "distance": _LENGTH},
    ),
    "formulas.rc_frequency": Case(
        formulas.rc_frequency,
        truth.rc_frequency,
        {"resistance": _RESISTANCE, "capacitance": _CAPACITANCE},
    ),
    "formulas.lc_frequency": Case(
        formulas.lc_frequency,
        truth.lc_frequency,
        {"inductance": _INDUCTANCE, "capacitance": _CAPACITANCE},
    ),
    "formulas.proximity_inductance": Case(
        formulas.proximity_inductance,
        _plain_inductance,
        {
            **{name: r for name, r in _COIL.items() if name != "capacitance"},
            "distance": Range(_ZERO, (1e-6, 1.0)),
        },
        _BELOW_BASE,
    ),
    "formulas.proximity_frequency": Case(
        formulas.proximity_frequency,
        partial(_only, truth.proximity_at, "frequency"),
        {**_COIL, "distance": Range(_ZERO, (1e-6, 1.0))},
        _BELOW_BASE,
    ),
    "formulas.coil_current": Case(
        formulas.coil_current,
        partial(_only, truth.coil_current, "magnitude"),
        {
            "voltage": _VOLTAGE,
            "resistance": _RESISTANCE,
            "inductance": _INDUCTANCE,
            "frequency": _FREQUENCY,
        },
    ),
    "formulas.coil_energy": Case(
        formulas.coil_energy,
        _plain_energy,
        {
            "voltage": _VOLTAGE,
            "resistance": _RESISTANCE,
            "inductance": _INDUCTANCE,
            "time": Range(_ZERO, (1e-6, 1.0)),
        },
    ),
    "formulas.icm_response": Case(
        formulas.icm_response,
        _plain_response,
        {
            "time_constant": _PLAIN,
            "angular_frequency": _PLAIN,
            "time": _PLAIN,
            "phase": Range(_ANY, (1e-2, 1e2), extent=(1e-300, 1e6)),
        },
    ),
}
"""All that `eskin.models` offers but the Euler steps of eq. 31, which enclose nothing by design,
and the matrices of `eskin.models.icm.state_space`, which are plain numbers."""
