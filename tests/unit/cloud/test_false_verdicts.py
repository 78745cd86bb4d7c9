"""The expected number of false verdicts a year is a bound, and 0 where errors are bounded."""

from __future__ import annotations

from fractions import Fraction
from itertools import accumulate
from typing import TYPE_CHECKING

import pytest
from eskin_cloud.query.channel_runs import as_signal
from eskin_cloud.query.stored_verdicts import YEAR, SampledChannel, StoredVerdicts, false_a_year
from eskin_cloud.rollup.samples import read_samples
from eskin_cloud.store.read.window import Window
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from eskin.monitor import Channel, Eventually, Historically, evaluate
from tests.support.examples import examples
from tests.unit.cloud.clouds import emptied, put
from tests.unit.cloud.messages import CHANNEL, DT, NODE, START, stretch
from tests.unit.cloud.test_stored_verdicts import sources_of

if TYPE_CHECKING:
    from eskin_cloud.store import Store

    from tests.unit.cloud.clouds import Stand

STEP = 10
CHANNELS = st.builds(
    SampledChannel,
    step=st.integers(1, 10**10),
    error=st.integers(0, 10**10),
    coverage=st.floats(0.0, 1.0),
    reach=st.integers(0, 10**14),
)


@given(st.lists(CHANNELS, max_size=4))
def test_it_is_rounded_up(channels: list[SampledChannel]) -> None:
    beyond = Fraction(0)
    for each in channels:
        held = (each.reach + 2 * each.error) // each.step + 2
        beyond += held * (1 - Fraction(each.coverage))
    verdicts = sum((Fraction(YEAR, each.step) for each in channels), Fraction(0))
    exact = verdicts * min(beyond, Fraction(1))
    found = Fraction(false_a_year(channels))
    assert exact <= found <= exact * (1 + Fraction(1, 2**51))
    assert (found == 0) is (beyond == 0)


@settings(max_examples=examples(60), suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    runs=st.lists(st.tuples(st.integers(0, 40), st.integers(1, 12)), min_size=1, max_size=4),
    error=st.integers(0, 40),
    ends=st.tuples(st.integers(0, 60), st.integers(0, 60)).map(sorted),
    past=st.booleans(),
)
def test_no_verdict_is_false_with_a_greater_probability(
    store: Store,
    runs: list[tuple[int, int]],
    error: int,
    ends: list[int],
    past: bool,  # noqa: FBT001 -- drawn
) -> None:
    lengths = [pause + n * STEP for pause, n in runs]
    begins = accumulate(lengths[:-1], initial=0)
    frames = [
        stretch(
            number, [1.0] * n, [2.0] * n, time=(START + t - error, START + t + error),
            dt=STEP, coverage=0.999,
        )
        for number, (t, (_, n)) in enumerate(zip(begins, runs, strict=True))
    ]  # fmt: skip
    put(emptied(store), *frames)
    bounds = ends[0], ends[1]
    formula = (Historically if past else Eventually)(bounds, Channel(CHANNEL) > Fraction(3, 2))
    window = Window(START - 200, START + sum(lengths) + 200)
    with sources_of(store, formula) as sources:
        stored = StoredVerdicts(formula, sources)
        (*_,) = stored.pieces(window)
        signal = as_signal(read_samples(*sources[CHANNEL], window), "F")
    whole = evaluate(formula, {CHANNEL: signal})
    least = min(whole.coverage(t) for t in range(window.start, window.end, 7))
    assert stored.false_a_year >= (1 - least) * YEAR / STEP * (1 - 1e-9)


@pytest.mark.anyio
@pytest.mark.parametrize("coverage", [1.0, 0.999999])
async def test_totals_of_a_formula_state_it(stand: Stand, coverage: float) -> None:
    put(stand.cloud.store, stretch(0, [1.0] * 100, [2.0] * 100, coverage=coverage))
    query = {"node": NODE, "start": START, "end": START + 99 * DT}
    formula = f"once[0,{5 * DT}ns] {CHANNEL} > 1"
    url = "/api/v1/monitors/evaluation/time"
    found = (await stand.get(url, formula=formula, **query)).json()
    # One sample beside those within the window, each of which each verdict depends on.
    expected = YEAR / DT * 7 * (1 - coverage)
    assert found["false_a_year"] == pytest.approx(expected)
    assert expected <= found["false_a_year"]
    plain = (await stand.get(f"/api/v1/series/{NODE}/{CHANNEL}/time", above=1, **query)).json()
    assert "false_a_year" not in plain
