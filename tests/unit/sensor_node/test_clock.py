from __future__ import annotations

import numpy as np
from eskin_sensor_node.machine.clock import Clock, Crystal, clock_generator
from hypothesis import given
from hypothesis import strategies as st

from tests.unit.sensor_node.designs import START, clock_at

ERRORS = st.integers(0, 10**10)
DRIFTS = st.integers(0, 10**7)
SEEDS = st.integers(0, 2**32)
TICKS = st.integers(0, 10**15)


@given(ERRORS, DRIFTS, SEEDS, TICKS)
def test_time_enclosure_holds_the_true_time(error: int, drift: int, seed: int, ticks: int) -> None:
    clock = clock_at(lambda: 0, rtc_error=error, drift=drift, seed=seed)
    earliest, latest = clock.known.enclosure(ticks)
    assert earliest <= clock.true_time(ticks) <= latest
    assert abs((latest - earliest) / 2 - error - ticks * drift / 1e9) <= 1.0 + 1e-12 * ticks


@given(DRIFTS, SEEDS, TICKS, st.integers(0, 10**12))
def test_lasting_enclosure_moves_on_with_the_samples(
    drift: int, seed: int, ticks: int, lasting: int
) -> None:
    clock = clock_at(lambda: 0, rtc_error=0, drift=drift, seed=seed)
    earliest, latest = clock.known.enclosure(ticks, lasting)
    for later in (0, lasting // 3, lasting):
        true = clock.true_time(ticks + later)
        assert earliest + later <= true <= latest + later


def test_crystal_drifts_by_its_own_amount_and_never_stands_still() -> None:
    ticks = np.arange(0, 10**13, 10**10)
    rates = [np.diff(Crystal(50_000, clock_generator(s)).elapsed(ticks)[0]) for s in range(9)]
    errors = np.array([rate.mean() / 1e10 - 1.0 for rate in rates])
    assert np.unique(errors).size == 9
    assert np.abs(errors).max() > 1e-5
    # Its temperature moves it, too.
    assert all(np.ptp(rate) > 1.0 for rate in rates)


def test_emulated_time_runs_at_its_speed_from_the_present() -> None:
    real = [5_000]
    clock = Clock(
        start=START,
        monotonic=lambda: real[0],
        speed=20.0,
        rtc_error=0,
        drift=0,
        seed=1,
        boot=1,
    )
    assert clock.ticks() == 0
    real[0] += 1_000_000_000
    assert clock.ticks() == 20_000_000_000
    assert clock.true_time(clock.ticks()) == START + 20_000_000_000
    assert clock.seconds_until(40_000_000_000) == 1.0
