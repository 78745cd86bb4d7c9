"""Times in a state hold for every signal and every clock within the intervals."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from eskin_cloud.query.occupancy import Occupancy, measure_occupancy
from eskin_cloud.query.predicate import Predicate
from eskin_cloud.store.read.lookup import find_channel
from eskin_cloud.store.read.window import Window
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from tests.unit.cloud.clouds import emptied, put
from tests.unit.cloud.messages import CHANNEL, DT, NODE, START, stretch
from tests.unit.cloud.test_comparison import drawn_truth, said_of, samples_of, value_at, windows

if TYPE_CHECKING:
    from eskin_cloud.store import Store

    from eskin.wire.frames import Frame
    from tests.unit.cloud.clouds import Stand

SERIES = f"/api/v1/series/{NODE}/{CHANNEL}"
ABOVE = Predicate(0.2, None, strict=True)


def ask(store: Store, said: list[Frame], window: Window) -> Occupancy:
    put(emptied(store), *said)
    with store.read() as connection:
        row = find_channel(connection, NODE, CHANNEL)
        return measure_occupancy(connection, row, window, ABOVE)


def near(start: int, error: int, level: float, sequence: int, n: int = 4) -> Frame:
    moment = START + start
    time = moment - error, moment + error
    return stretch(sequence, [level] * n, [level] * n, time=time, dt=10)


@settings(
    max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(said=said_of(CHANNEL), window=windows, seed=st.integers(0, 2**32))
@example(said=[near(0, 0, 1.0, 0), near(40, 30, 0.0, 1)], window=Window(START, START + 40), seed=0)
@example(
    said=[near(0, 0, 1.0, 0, n=1), near(90, 95, 0.0, 1)], window=Window(START, START + 10), seed=0
)
@example(said=[near(0, 30, 1.0, 0), near(40, 0, 0.0, 1)], window=Window(START, START + 80), seed=0)
def test_every_signal_and_every_clock_within_the_intervals_agrees(
    store: Store, said: list[Frame], window: Window, seed: int
) -> None:
    found = ask(store, said, window)
    random = np.random.default_rng(seed)
    for _ in range(4):
        signal = drawn_truth(random, samples_of(said))
        values = [value_at(signal, moment) for moment in range(window.start, window.end)]
        inside = sum(value is not None and value > 0.2 for value in values)
        assert found.time[0] <= inside <= found.time[1] + found.unknown


def test_stretch_loses_the_time_error_at_its_ends_and_no_more(store: Store) -> None:
    said = [near(0, 2, 0.0, 0), near(40, 2, 1.0, 1), near(80, 3, 1.0, 2), near(120, 5, 0.0, 3)]
    found = ask(store, said, Window(START, START + 160))
    # The greatest time error of frames that follow each other counts at both ends.
    assert found.time == (80 - 3 - 5, 160 - (40 - 2 - 3) - (40 - 5 - 5))
    assert (found.unknown, found.error) == (0, 5)


def test_time_is_exact_where_clocks_are(store: Store) -> None:
    found = ask(store, [near(0, 0, 0.0, 0), near(40, 0, 1.0, 1)], Window(START, START + 75))
    assert found.time == (35, 35)


def test_clock_behind_the_window_counts_as_far_as_it_reaches(store: Store) -> None:
    window = Window(START, START + 40)
    assert ask(store, [near(0, 0, 1.0, 0), near(45, 30, 0.0, 1)], window).time == (15, 40)
    assert ask(store, [near(0, 0, 1.0, 0), near(90, 30, 0.0, 1)], window).time == (40, 40)


@pytest.mark.anyio
@pytest.mark.parametrize("path", ["/threshold", "/anomalies"])
async def test_moments_of_a_bad_clock_may_all_lie_outside_of_the_window(
    stand: Stand, path: str
) -> None:
    error = 10**10
    for sequence, level in enumerate([0.0, 20.0]):
        moment = START + sequence * 100 * DT
        time = moment - error, moment + error
        put(stand.cloud.store, stretch(sequence, [level] * 100, [level + 1] * 100, time=time))
    question: dict[str, Any] = {"above": 10}
    if path == "/anomalies":
        question = {"model": "constant", "parameter": "value:0:10"}
    window = question | {"start": START, "end": START + 200 * DT}
    (segment,) = (await stand.get(SERIES + path, **window)).json()["items"]
    assert (segment["verdict"], segment["time_error"]) == ("certain", error)
    place = "/time" if path == "/threshold" else f"{path}/time"
    found = (await stand.get(SERIES + place, **window)).json()
    assert found["time_s"] == {"lo": 0.0, "hi": 0.2}
    assert found["time_error"] == error


@pytest.mark.anyio
@pytest.mark.parametrize(
    ("path", "question"),
    [
        ("threshold", {"above": 10}),
        ("anomalies", {"model": "constant", "parameter": "value:0:1"}),
    ],
)
async def test_segment_counts_the_samples_of_blocks_that_overlap(
    stand: Stand, path: str, question: dict[str, Any]
) -> None:
    bounds = [20.0] * 100, [21.0] * 100
    late = START + DT // 2
    put(
        stand.cloud.store,
        stretch(0, *bounds, boot=1, coverage=0.999),
        stretch(0, *bounds, boot=2, coverage=0.999, time=(late, late)),
        stretch(1, *bounds, boot=3, coverage=0.999),
    )
    window = question | {"start": START - DT, "end": START + 1000 * DT}
    (segment,) = (await stand.get(f"{SERIES}/{path}", **window)).json()["items"]
    time = "time" if path == "threshold" else f"{path}/time"
    whole = (await stand.get(f"{SERIES}/{time}", **window)).json()
    assert segment["coverage"] == whole["coverage"] == pytest.approx(0.7)
