from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from sensor_node.clock import Clock
from tests.sensor_node.designs import START


@given(st.integers(0, 10**10), st.integers(0, 2**32), st.integers(0, 10**17))
def test_time_enclosure_holds_the_true_time(error: int, seed: int, ticks: int) -> None:
    random = np.random.default_rng(seed)
    clock = Clock(start=START, monotonic=lambda: 0, speed=1.0, rtc_error=error, random=random)
    earliest, latest = clock.enclosure(ticks)
    assert earliest <= clock.true_time(ticks) <= latest
    assert latest - earliest == 2 * error


def test_emulated_time_runs_at_its_speed_from_the_present() -> None:
    real = [5_000]
    random = np.random.default_rng(1)
    clock = Clock(start=START, monotonic=lambda: real[0], speed=20.0, rtc_error=0, random=random)
    assert clock.ticks() == 0
    real[0] += 1_000_000_000
    assert clock.ticks() == 20_000_000_000
    assert clock.true_time(clock.ticks()) == START + 20_000_000_000
    assert clock.seconds_until(40_000_000_000) == 1.0
