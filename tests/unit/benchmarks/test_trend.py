"""A growing process is distinguished from a flat one; what cannot be is called undecided."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.trend import Trend

HOUR = np.arange(0.0, 3600.0, 6.0)
BASE = 1e8


def trend(growth: float, *, noise: float = 0.0, seconds: np.ndarray = HOUR) -> Trend:
    """Memory that grows by a share of 100 MB an hour, with noise of another share."""
    random = np.random.default_rng(1)
    used = BASE * (1.0 + growth * seconds / 3600.0 + noise * random.normal(size=seconds.size))
    return Trend.of(list(seconds), list(used))


def test_flat_memory_is_flat() -> None:
    found = trend(0.0, noise=0.01)
    assert found.lo <= 0.0 <= found.hi
    assert found.verdict == "flat"


def test_leak_grows_and_its_slope_is_enclosed() -> None:
    found = trend(0.2, noise=0.01)
    assert found.lo <= 0.2 * BASE / found.mean <= found.hi
    assert found.verdict == "grows"


def test_short_noisy_run_is_undecided() -> None:
    assert trend(0.0, noise=0.02, seconds=np.arange(0.0, 60.0)).verdict == "undecided"


def stepped(growth: float, seed: int) -> Trend:
    """The same, and four times an hour a burst leaves a heap some percent higher for minutes."""
    random = np.random.default_rng(seed)
    used = BASE * (1.0 + growth * HOUR / 3600.0 + 0.001 * random.normal(size=HOUR.size))
    for _ in range(random.poisson(4)):
        begin, lasts = random.uniform(0.0, 3600.0), random.exponential(360.0)
        height = random.uniform(0.02, 0.07) * BASE
        used += np.where((begin <= HOUR) & (begin + lasts > HOUR), height, 0.0)
    return Trend.of(list(HOUR), list(used))


def test_steps_neither_hide_a_leak_nor_look_like_one() -> None:
    leaks = [stepped(0.08, seed).verdict for seed in range(100)]
    assert leaks.count("flat") <= 2
    assert leaks.count("grows") >= 70
    still = [stepped(0.0, seed).verdict for seed in range(100)]
    assert still.count("grows") <= 2
    assert still.count("flat") >= 70


def test_filling_of_caches_at_the_start_is_left_out() -> None:
    used = BASE * np.where(HOUR < 600.0, 0.5 + HOUR / 1200.0, 1.0)
    assert Trend.of(list(HOUR), list(used)).verdict == "flat"


def test_too_few_samples_are_refused() -> None:
    with pytest.raises(ValueError, match="at least 54"):
        Trend.of([0.0, 1.0], [1.0, 1.0])
