"""Monitors while samples arrive: one formula, ten thousand of them, and rtamt on the same samples.

rtamt (in an environment of its own) has point values and discrete time; its online monitor is
compiled from its formula into Python objects. It gets the samples' middles.
"""

from __future__ import annotations

import json
import subprocess
import time
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING, Final

import numpy as np

from benchmarks.report import Row, at_most
from eskin.monitor import Monitor, parse

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]

FORMULA: Final = (
    "always[0,1280ms](p > 0.8 kPa implies eventually[0,1280ms] p < 0.2 kPa) and p < 3 kPa"
)
"""Three atoms, two windows of 64 samples."""
_PEER_FORMULA: Final = "always[0:64]((p > 0.8) implies (eventually[0:64](p < 0.2))) and (p < 3)"
_UNITS: Final = {"p": "kPa"}
_PERIOD: Final = 20_000_000
_WARM: Final = 512
_SAMPLES: Final = 64 * 256
_ROUNDS: Final = 5
_STRETCHES: Final = (1, 4, 50, 64)
_BOUND_AT: Final = 64
_MONITORS: Final = 10_000
_PYTHON: Final = Path(".venv/rtamt/bin/python")
_PEER: Final = Path(__file__).parent / "rtamt_online.py"


def measure_monitors() -> list[Row]:
    """Medians of interleaved rounds; a round pushes all samples, and takes after each stretch."""
    values = _signal(_WARM + _SAMPLES)
    costs: dict[int, list[float]] = {stretch: [] for stretch in _STRETCHES}
    peer = []
    for _ in range(_ROUNDS):
        for stretch, found in costs.items():
            found.append(_online_us(values, stretch))
        peer.append(_rtamt_us(values))
    theirs = median(peer)
    rows = [
        Row(
            f"monitor: 3 atoms, 2 windows of 64, {stretch} at once",
            median(found),
            "us/sample",
            "rtamt online",
            theirs,
            theirs / median(found),
        )
        for stretch, found in costs.items()
    ]
    met = at_most(
        f"the same, {_BOUND_AT} at once",
        median(costs[_BOUND_AT]),
        "us/sample",
        1.0,
    )
    load = median(_many_seconds(values) for _ in range(3))
    return [
        *rows,
        met,
        at_most(f"{_MONITORS} monitors at 50 Hz, a second at once", load, "cores", 0.5),
    ]


def _signal(count: int) -> Floats:
    """Touches of a second and a half, every two seconds, with noise."""
    seconds = np.arange(count) * (_PERIOD / 1e9)
    noise = np.random.default_rng(1).normal(size=count)
    values: Floats = np.maximum(np.sin(np.pi * seconds), 0.0) + 0.01 * noise
    return values


def _online_us(values: Floats, stretch: int) -> float:
    instants = np.arange(values.size, dtype=np.int64) * _PERIOD
    latest, lo, hi = instants + 1000, values - 0.01, values + 0.01
    monitor = Monitor(parse(FORMULA), _UNITS)
    begun = 0.0
    for at in range(0, values.size, stretch):
        if at == _WARM // stretch * stretch:
            begun = time.perf_counter()
        part = slice(at, at + stretch)
        monitor.extend("p", instants[part], latest[part], lo[part], hi[part], _PERIOD)
        monitor.take()
    return (time.perf_counter() - begun) / _SAMPLES * 1e6


def _many_seconds(values: Floats) -> float:
    """Seconds of work for one second of samples of many monitors, when their windows are full."""
    stretch, formula = 50, parse(FORMULA)
    instants = np.arange(values.size, dtype=np.int64) * _PERIOD
    latest, lo, hi = instants + 1000, values - 0.01, values + 0.01
    monitors = [Monitor(formula, _UNITS) for _ in range(_MONITORS)]
    spent = 0.0
    for at in range(0, 6 * stretch, stretch):
        part = slice(at, at + stretch)
        begun = time.perf_counter()
        for monitor in monitors:
            monitor.extend("p", instants[part], latest[part], lo[part], hi[part], _PERIOD)
            monitor.take()
        spent = time.perf_counter() - begun
    return spent


def _rtamt_us(values: Floats) -> float:
    done = subprocess.run(
        [_PYTHON, _PEER],
        input=json.dumps(
            {"formula": _PEER_FORMULA, "values": values[: _WARM + 4096].tolist(), "warm": _WARM}
        ),
        capture_output=True,
        text=True,
        check=True,
        timeout=300,
    )
    return float(done.stdout)


if __name__ == "__main__":
    from rich.console import Console

    from benchmarks.report import as_table

    Console(width=140).print(as_table(measure_monitors()))
