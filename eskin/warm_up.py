"""Compiles what a notebook uses, so that no first call waits for the compiler."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np

from eskin import models
from eskin.contacts import Skin, track_contacts
from eskin.identification import SetMembershipEstimator, relaxed_intersection
from eskin.interval import Interval
from eskin.models.icm import IcmParameters
from eskin.monitor import Monitor, parse
from eskin.peaks import find_peaks

if TYPE_CHECKING:
    from collections.abc import Callable

_OF_ONE: Final = (
    Interval.sqr, Interval.sqrt, Interval.exp, Interval.exp2, Interval.exp10, Interval.expm1,
    Interval.log, Interval.log2, Interval.log10, Interval.log1p, Interval.sin, Interval.cos,
    Interval.tan, Interval.asin, Interval.acos, Interval.atan, Interval.sinh, Interval.cosh,
    Interval.tanh, Interval.asinh, Interval.acosh, Interval.atanh, Interval.cbrt, Interval.sum,
    Interval.cumsum,
)  # fmt: skip
_OF_TWO: Final = (
    Interval.__add__, Interval.__sub__, Interval.__mul__, Interval.__truediv__, Interval.hypot,
    Interval.pow, Interval.atan2,
)  # fmt: skip
_AREA: Final = Interval(1e-4, 2e-4)
_FARAD: Final = Interval(1e-12, 2e-12)
_CHAIN: Final[dict[str, Any]] = {
    "minimum_capacitance": 1e-12,
    "maximum_capacitance": 2e-12,
    "frequency": 1.0,
}
_COIL: Final = {
    "base_inductance": 1e-2,
    "inductance_change": 1e-3,
    "damping": 1.0,
    "capacitance": 1e-6,
}
_TIMES: Final = np.array([0.0, 1e-3])


def _intervals() -> None:
    x = Interval([0.25, 0.5], [0.5, 0.75])
    for one in _OF_ONE:
        one(x)
    for two in _OF_TWO:
        two(x, x)
    x.fma(x, x)
    x.pown(3)


def _peaks() -> None:
    find_peaks(Interval([0.0, 1.0, 0.0]), prominence=0.5)


def _contacts() -> None:
    """A contact with a core, a region without one, and at the last instant a new core."""
    skin = Skin.grid(1, 3, pitch=1e-3, area=1e-6)
    pressures = np.array([[2e3, 0.0, 1e3], [1e3, 0.0, 1e3], [2e3, 0.0, 1e3]])
    times = np.array([[0, 0], [1, 1], [2, 2]])
    track_contacts(pressures - 100.0, pressures + 100.0, times, skin, 1e3)


def _monitors() -> None:
    monitor = Monitor(parse("once[0,1ns] p > 0"), {"p": "1"})
    monitor.push("p", 0, 0, 1.0, 1.0, period=1)
    monitor.take()


def _identification() -> None:
    online = SetMembershipEstimator(0.0, outliers=0, memory=1)
    online.push(0, 0, Interval(1.0, 2.0))
    online.at(0)
    relaxed_intersection(Interval([1.0, 1.0], [2.0, 2.0]), 0)


def _capacitive_models() -> None:
    models.capacitance(relative_permittivity=1.0, area=_AREA, distance=1e-3)
    models.moving_plate(
        _TIMES, area=_AREA, minimum_distance=1e-3, maximum_distance=2e-3, frequency=1.0
    )
    models.touch(
        _TIMES, minimum_area=1e-4, maximum_area=2e-4, distance=1e-3, voltage=1.0, frequency=1.0
    )
    models.touch_of_area(_AREA, distance=1e-3, voltage=1.0)
    models.rc_frequency(resistance=1e3, capacitance=_FARAD)
    models.rc_frequency_paper(resistance=1e3, capacitance=_FARAD)
    models.harmonic_capacitance(_TIMES, **_CHAIN)
    models.capacitive_chain(_TIMES, resistance=1e3, transconductance=1e-3, **_CHAIN)
    models.chain_current(_TIMES, transconductance=1e-3, **_CHAIN)
    models.alternating_capacitance(_TIMES, **_CHAIN)
    models.alternating_capacitance_paper(_TIMES, **_CHAIN)
    models.alternating_current(_TIMES, voltage=1.0, voltage_frequency=50.0, **_CHAIN)
    models.alternating_current_paper(_TIMES, voltage=1.0, voltage_frequency=50.0, **_CHAIN)


def _inductive_models() -> None:
    models.lc_frequency(inductance=1e-3, capacitance=_FARAD)
    models.coil_current(voltage=1.0, resistance=1.0, inductance=1e-3, frequency=50.0)
    models.coil_energy(_TIMES, voltage=1.0, loss_resistance=5.0, inductance=1e-2)
    models.proximity(_TIMES, mean_distance=1e-2, distance_amplitude=1e-3, frequency=1.0, **_COIL)
    models.proximity_at(distance=1e-2, **_COIL)
    models.oscillation(_TIMES, voltage=5.0, frequency=Interval([50.0]))
    models.resonance(
        _TIMES, voltage=1.0, resistance=1.0, capacitance=1e-6, source_frequency=1e3,
        minimum_inductance=5e-3, maximum_inductance=1e-2, frequency=1.0,
    )  # fmt: skip
    models.energy_flow(
        _TIMES, voltage=1.0, switch_resistance=1.0, coil_resistance=1.0, inductance=1e-3,
        capacitor_resistance=10.0, capacitance=1e-6,
    )  # fmt: skip


def _hybrid_sensor() -> None:
    """One row for each kernel: all thin, the source thin, nothing thin."""
    some = Interval(0.99, 1.01)
    for made in (
        IcmParameters(),
        IcmParameters(coil_resistance=10e3 * some, capacitor_resistance=2419.0 * some),
        IcmParameters(frequency=50.0 * some),
    ):
        made.source_voltage(_TIMES)
        made.magfes_current(_TIMES)
        made.ecfes_voltage(_TIMES)


STEPS: Final[dict[str, Callable[[], object]]] = {
    "arithmetic and functions of intervals": _intervals,
    "peaks": _peaks,
    "contacts": _contacts,
    "monitors": _monitors,
    "identification": _identification,
    "capacitive models": _capacitive_models,
    "inductive models": _inductive_models,
    "the hybrid sensor (ICM)": _hybrid_sensor,
}
"""What is compiled, and what uses each of its kernels once."""
