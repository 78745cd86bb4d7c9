"""Cost of the models with intervals: against plain numpy, other libraries, and the memory."""

from __future__ import annotations

import time
from statistics import median
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.interval_peers import (
    NUMPY,
    PEERS,
    capacitance,
    chain_current,
    prepare,
    proximity_frequency,
)
from benchmarks.report import Row
from eskin import models
from eskin.interval import Interval

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    Floats = NDArray[np.float64]
    Work = tuple[str, Callable[[], object], Callable[[], object]]

_SAMPLES = 1_000_000
_ROUNDS = 15
_PEER_ROUNDS = 5
_TARGETS = {"codac": 200.0, "precise-numpy": 10.0}
_CHAIN = {
    "minimum_capacitance": Interval(9e-12, 11e-12),
    "maximum_capacitance": Interval(90e-12, 110e-12),
    "transconductance": Interval(0.9e-3, 1.1e-3),
}
_COIL = {
    "base_inductance": Interval(9.5e-3, 10.5e-3),
    "inductance_change": Interval(4.5e-3, 5.5e-3),
    "damping": Interval(9.0, 11.0),
    "capacitance": Interval(0.9e-6, 1.1e-6),
    "mean_distance": Interval(0.019, 0.021),
    "distance_amplitude": Interval(0.009, 0.011),
}


def measure_models() -> list[Row]:
    """All rows: floors, peers, memory, growth."""
    return [*_against_numpy(), *_against_peers(), _memory(), *_growth()]


def _plates(n: int) -> dict[str, Interval]:
    generator = np.random.default_rng(1)
    middle = {
        "relative_permittivity": generator.uniform(1.0, 5.0, n),
        "area": generator.uniform(1e-4, 2e-4, n),
        "distance": generator.uniform(1e-3, 5e-3, n),
    }
    return {k: Interval(0.95 * v, 1.05 * v) for k, v in middle.items()}


def _numpy_chain(times: Floats) -> tuple[Floats, Floats, Floats, Floats]:
    """Eq. 5 and 6, V and I, as the paper writes them."""
    charge = 10e-12 + 90e-12 * (0.5 + 0.5 * np.sin(2.0 * np.pi * 2.0 * times))
    frequency = 1.0 / (2.0 * np.pi * 1e3 * charge)
    voltage = frequency / frequency.max()
    return charge, frequency, voltage, 1e-3 * voltage


def _numpy_proximity(times: Floats) -> tuple[Floats, Floats, Floats]:
    distance = 0.02 + 0.01 * np.sin(2.0 * np.pi * times)
    inductance = 10e-3 - 5e-3 * np.exp(-10.0 * distance)
    return distance, inductance, 1.0 / (2.0 * np.pi * np.sqrt(inductance * 1e-6))


def _against_numpy() -> list[Row]:
    times, plates = np.linspace(0.0, 10.0, _SAMPLES), _plates(_SAMPLES)
    plain = {k: v.inf for k, v in plates.items()}
    works: list[tuple[str, float, Callable[[], object], Callable[[], object]]] = [
        (
            "eq. 2, three interval parameters",
            1 / 4,
            lambda: models.capacitance(**plates),
            lambda: capacitance(plain, NUMPY),
        ),
        (
            "eq. 5 and 6, V, I: all four",
            1 / 2,
            lambda: models.capacitive_chain(times, resistance=Interval(990.0, 1010.0), **_CHAIN),
            lambda: _numpy_chain(times),
        ),
        (
            "eq. 5 and 6, V, I: the current",
            1.0,
            lambda: models.chain_current(times, **_CHAIN),
            lambda: _numpy_chain(times),
        ),
        (
            "eq. 11 to 13",
            1 / 2.5,
            lambda: models.proximity(times, **_COIL),
            lambda: _numpy_proximity(times),
        ),
    ]
    rows = []
    for name, target, ours, floor in works:
        cost, plain_cost = _medians([ours, floor], _ROUNDS, _SAMPLES)
        rows.append(_compared(name, cost, "plain numpy", plain_cost, target))
    return rows


def _against_peers() -> list[Row]:
    times = np.linspace(0.0, 10.0, _SAMPLES)
    plates = _plates(_SAMPLES)
    works: list[tuple[str, Callable[..., Any], dict[str, Interval], Callable[[], object]]] = [
        ("eq. 2", capacitance, plates, lambda: models.capacitance(**plates)),
        (
            "eq. 5 and 6, V, I",
            chain_current,
            _spread(
                times,
                transconductance=_CHAIN["transconductance"],
                ratio=_CHAIN["maximum_capacitance"] / _CHAIN["minimum_capacitance"],
            ),
            lambda: models.chain_current(times, **_CHAIN),
        ),
        (
            "eq. 11 to 13",
            proximity_frequency,
            _spread(
                times,
                base=_COIL["base_inductance"],
                change=_COIL["inductance_change"],
                damping=_COIL["damping"],
                capacitance=_COIL["capacitance"],
                mean=_COIL["mean_distance"],
                amplitude=_COIL["distance_amplitude"],
            ),
            lambda: models.proximity(times, **_COIL),
        ),
    ]
    rows = []
    for name, formula, values, ours in works:
        for peer in PEERS:
            calls = [ours, prepare(formula, peer, values)]
            cost, theirs = _medians(calls, _PEER_ROUNDS, _SAMPLES, peer.elements)
            rows.append(_compared(name, cost, peer.name, theirs, _TARGETS.get(peer.name)))
    return rows


def _spread(times: Floats, **parameters: Interval) -> dict[str, Interval]:
    """Every value at every time, as the peers need it."""
    spread = {
        name: Interval(
            np.broadcast_to(value.inf, times.shape), np.broadcast_to(value.sup, times.shape)
        )
        for name, value in parameters.items()
    }
    return {"time": Interval(times)} | spread


def _memory() -> Row:
    """Bytes that eq. 2 must read and write, a second, beside a plain copy of as many."""
    plates = _plates(_SAMPLES)
    source = np.ones(4 * _SAMPLES)
    target = np.empty_like(source)
    cost, copy = _medians(
        [lambda: models.capacitance(**plates), lambda: np.copyto(target, source)],
        _ROUNDS,
        _SAMPLES,
    )
    moved = 8 * 8  # six bounds in, two out: as much as the copy reads and writes
    return Row("eq. 2, memory moved", moved / cost, "GB/s", "copy", moved / copy, copy / cost)


def _growth() -> list[Row]:
    rows = []
    for power in range(3, 8):
        n = 10**power
        rounds = min(1000, max(3, 10_000_000 // n))
        for name, ours, floor in (_eq_2(n), _current(n)):
            cost, plain_cost = _medians([ours, floor], rounds, n)
            label = f"{name}, 1e{power} samples"
            rows.append(_compared(label, cost, "plain numpy", plain_cost, None))
    return rows


def _eq_2(n: int) -> Work:
    plates = _plates(n)
    plain = {k: v.inf for k, v in plates.items()}
    return "eq. 2", lambda: models.capacitance(**plates), lambda: capacitance(plain, NUMPY)


def _current(n: int) -> Work:
    times = np.linspace(0.0, 10.0, n)
    return "current", lambda: models.chain_current(times, **_CHAIN), lambda: _numpy_chain(times)


def _medians(
    calls: list[Callable[[], object]], rounds: int, elements: int, others: int | None = None
) -> tuple[float, float]:
    """Median nanoseconds an element of two calls that take turns."""
    taken: list[list[float]] = [[], []]
    for call in calls:
        call()  # compiles, and touches memory
    for _ in range(rounds):
        for call, times in zip(calls, taken, strict=True):
            start = time.perf_counter()
            call()
            times.append(time.perf_counter() - start)
    return (
        median(taken[0]) / elements * 1e9,
        median(taken[1]) / (others or elements) * 1e9,
    )


def _compared(name: str, cost: float, peer: str, peer_cost: float, target: float | None) -> Row:
    ratio = peer_cost / cost
    met = None if target is None else ratio >= target
    return Row(name, cost, "ns/element", peer, peer_cost, ratio, target, met)
