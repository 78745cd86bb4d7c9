"""Hulls: buckets, their times, and their coverage."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from eskin_cloud.query.series import read_series
from eskin_cloud.rollup.hulls import bucket_width
from eskin_cloud.store import Store
from eskin_cloud.store.read.lookup import find_channel
from eskin_cloud.store.read.window import Window
from hypothesis import given
from hypothesis import strategies as st

from eskin.union_bound import union_coverage
from tests.unit.cloud.clouds import put
from tests.unit.cloud.messages import CHANNEL, NODE, START, stretch

if TYPE_CHECKING:
    from eskin_cloud.store import Store


@given(st.integers(1, 2**62), st.integers(1, 20_000))
def test_buckets_cover_the_window_with_times_exact_in_float64(span: int, points: int) -> None:
    width = bucket_width(span, points)
    assert width * points >= span
    starts = np.arange(-(-span // width)) * width
    assert [int(float(start)) for start in starts[-3:]] == starts[-3:].tolist()


def test_widely_spread_samples_keep_times_exact(store: Store) -> None:
    day = 86_400 * 10**9
    put(store, stretch(0), stretch(1, time=(START + 400 * day, START + 400 * day)))
    with store.read() as connection:
        row = find_channel(connection, NODE, CHANNEL)
        series = read_series(connection, row, Window(START, START + 401 * day), points=1000)
    assert series.resolution == "hull"
    assert [int(float(t)) for t in series.t] == series.t.tolist()
    assert np.flatnonzero(np.isfinite(series.lo)).size == 2


def test_last_bucket_answers_for_all_that_it_spans(store: Store) -> None:
    said = [
        stretch(n, [n], [n + 1], time=(START + n, START + n), dt=1, coverage=1.0 if n < 10 else 0.5)
        for n in range(12)
    ]
    put(store, *said)
    with store.read() as connection:
        row = find_channel(connection, NODE, CHANNEL)
        series = read_series(connection, row, Window(START, START + 10), points=3)
    assert (series.dt, series.t.tolist()) == (4, [0, 4, 8])
    assert series.hi.tolist() == [4.0, 8.0, 12.0]
    assert series.coverage == union_coverage(0.5, n=4)
