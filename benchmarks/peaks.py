"""Finding the peaks of a tube against scipy's ``find_peaks`` on a thin one of the same signal."""

from __future__ import annotations

import time
from statistics import median
from typing import TYPE_CHECKING, Final

import numpy as np
from scipy.signal import find_peaks as scipy_find_peaks

from benchmarks.report import Row
from eskin.peaks import PeakStream, find_peaks

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    Floats = NDArray[np.float64]

_SAMPLES: Final = 1_000_000
_BLOCK: Final = 500
_ROUNDS: Final = 7
_SCIPY: Final = "scipy"
_RADIUS: Final = 0.05
_PROMINENCES: Final = (0.01, 3.0)


def measure_peaks() -> list[Row]:
    """A million samples, whole and in blocks; ratios of interleaved repeats.

    A smooth signal is scipy's best case: it looks at local maxima only. In blocks, 2000 calls from
    Python then cost more than all of its work.
    """
    rows = []
    for kind, signal in _signals().items():
        for prominence in _PROMINENCES:
            rows += _against_scipy(f"peaks, {kind}, p = {prominence:g}", signal, prominence)
    return rows


def _signals() -> dict[str, Floats]:
    noise = np.random.default_rng(1).normal(size=_SAMPLES)
    slow = np.sin(np.arange(_SAMPLES) / 500.0)
    return {
        "noise": noise,
        "sine with noise": slow + 0.1 * noise,
        "random walk": noise.cumsum(),
        "sine": slow,
    }


def _against_scipy(name: str, signal: Floats, prominence: float) -> list[Row]:
    lows, highs = signal - _RADIUS, signal + _RADIUS
    calls: dict[str, Callable[[], object]] = {
        "thin tube": lambda: find_peaks(signal, signal, prominence=prominence),
        "tube": lambda: find_peaks(lows, highs, prominence=prominence),
        f"tube in blocks of {_BLOCK}": lambda: _stream(lows, highs, prominence),
        _SCIPY: lambda: scipy_find_peaks(signal, prominence=prominence),
    }
    costs = _milliseconds(calls)
    peer_cost = costs.pop(_SCIPY)
    return [_row(f"{name}, {way}", cost, peer_cost, 1.0) for way, cost in costs.items()]


def _stream(lows: Floats, highs: Floats, prominence: float) -> int:
    stream = PeakStream(prominence)
    found = sum(
        len(stream.feed(lows[start : start + _BLOCK], highs[start : start + _BLOCK]))
        for start in range(0, _SAMPLES, _BLOCK)
    )
    return found + len(stream.finish())


def _milliseconds(calls: dict[str, Callable[[], object]]) -> dict[str, float]:
    """Median milliseconds of calls that take turns."""
    taken: dict[str, list[float]] = {name: [] for name in calls}
    for call in calls.values():
        call()  # compiles, and touches memory
    for _ in range(_ROUNDS):
        for name, call in calls.items():
            start = time.perf_counter()
            call()
            taken[name].append(time.perf_counter() - start)
    return {name: median(times) * 1e3 for name, times in taken.items()}


def _row(name: str, cost: float, peer_cost: float, target: float) -> Row:
    ratio = peer_cost / cost
    return Row(name, cost, "ms", _SCIPY, peer_cost, ratio, target, ratio >= target)
