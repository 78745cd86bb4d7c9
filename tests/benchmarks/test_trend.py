"""A growing process is told from a flat one, and what cannot be told is said to be undecided."""

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


def test_filling_of_caches_at_the_start_is_left_out() -> None:
    used = BASE * np.where(HOUR < 600.0, 0.5 + HOUR / 1200.0, 1.0)
    assert Trend.of(list(HOUR), list(used)).verdict == "flat"


def test_too_few_samples_are_refused() -> None:
    with pytest.raises(ValueError, match="at least 54"):
        Trend.of([0.0, 1.0], [1.0, 1.0])
