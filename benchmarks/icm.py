"""Speed of the ICM's enclosures against the same formula in plain numpy, without intervals."""

from __future__ import annotations

import time
from statistics import median
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from benchmarks.report import Row
from eskin.interval import Interval
from eskin.models.icm import ecfes_voltage, magfes_current

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    Floats = NDArray[np.float64]

_ROUNDS: Final = 15
_TAXELS: Final = 1000
_TIMES: Final = 1000
_ELEMENTS: Final = _TAXELS * _TIMES
_PHASE: Final = float(np.radians(-46.0))
_SOURCE: Final[dict[str, Any]] = {"amplitude": 5.0, "frequency": 50.0, "phase": _PHASE}
_TARGETS: Final = {0.05: 2.0, 0.2: 10.0}


def measure_icm() -> list[Row]:
    """Nanoseconds an element of 1000 taxels × 1000 times; ratios of interleaved repeats."""
    rng = np.random.default_rng(1)
    spread = rng.uniform(0.5, 2.0, (_TAXELS, 1))
    t = np.linspace(0.0, 20e-3, _TIMES)
    rows = []
    for tolerance in _TARGETS:
        rows += [
            _voltage(t, 1e-6 * spread, tolerance),
            _current(t, 10e3, 1e-3 * spread, tolerance),
            _current(t, 1.0, 3e-3 * spread, tolerance),
        ]
    return rows


def _voltage(t: Floats, c: Floats, tolerance: float) -> Row:
    r, capacitance = _around(np.array(2419.0), tolerance), _around(c, tolerance)
    return _row(
        f"ICM u_c, R2 and C ±{100 * tolerance:g} %",
        tolerance,
        lambda: ecfes_voltage(t, **_SOURCE, capacitor_resistance=r, capacitance=capacitance),
        lambda: 5.0 * _plain(t, 2419.0 * c),
    )


def _current(t: Floats, r: float, inductance: Floats, tolerance: float) -> Row:
    resistance, around = _around(np.array(r), tolerance), _around(inductance, tolerance)
    return _row(
        f"ICM i1, R1 = {r:g} Ω and L ±{100 * tolerance:g} %",
        tolerance,
        lambda: magfes_current(t, **_SOURCE, coil_resistance=resistance, inductance=around),
        lambda: 5.0 / r * _plain(t, inductance / r),
    )


def _plain(t: Floats, tau: Floats) -> Floats:
    """Eq. 26 and 27 without their amplitude, in as few passes as numpy needs."""
    x = 2.0 * np.pi * 50.0 * tau
    theta = 2.0 * np.pi * 50.0 * t + _PHASE
    scale = 1.0 / (1.0 + x * x)
    left = (np.sin(_PHASE) - x * np.cos(_PHASE)) * scale
    values = np.sin(theta) * scale - np.cos(theta) * (x * scale) - left * np.exp(-t / tau)
    return np.asarray(values)


def _around(value: Floats, tolerance: float) -> Interval:
    return Interval(value * (1.0 - tolerance), value * (1.0 + tolerance))


def _row(
    name: str, tolerance: float, ours: Callable[[], Interval], plain: Callable[[], Floats]
) -> Row:
    bounds, values = ours(), plain()
    slack = 1e-12 * float(np.max(np.abs(values)))
    assert np.all((bounds.inf - slack <= values) & (values <= bounds.sup + slack))
    times = [(_seconds(ours), _seconds(plain)) for _ in range(_ROUNDS)]
    share = median(b / a for a, b in times)
    mine, floor = (median(pair[k] for pair in times) / _ELEMENTS * 1e9 for k in (0, 1))
    target = 1.0 / _TARGETS[tolerance]
    return Row(name, mine, "ns/element", "plain numpy", floor, share, target, share >= target)


def _seconds(call: Callable[[], object]) -> float:
    start = time.perf_counter()
    call()
    return time.perf_counter() - start
