"""Matrices of samples for tests, and which of their cells are samples."""

from __future__ import annotations

import numpy as np
from hypothesis import strategies as st

from eskin.interval import Interval
from eskin.wire.frames import Sampling

INF = np.inf
SIZES = (5e-324, 1e-310, 1e-15, 1.0, 1e5, 1e280, 1.7e308)
ENDS = st.one_of(
    st.floats(allow_nan=False),
    st.floats(-1.0, 1.0),
    st.sampled_from((0.0, -0.0, 5e-324, -5e-324, 2.0**950, -(2.0**950), 1.0, 1.0 + 2.0**-52)),
)


@st.composite
def samplings(draw: st.DrawFn) -> Sampling:
    columns = draw(st.integers(1, 8) | st.sampled_from((63, 64)))
    rows = draw(st.integers(1, 5) | st.just(40))
    strides = bytes(draw(st.lists(st.integers(0, 3), min_size=columns, max_size=columns)))
    first_row = draw(st.sampled_from((0, 1, 6, 1001, 2**53 - 1)))
    return Sampling(rows, columns, first_row, draw(st.sampled_from((b"", strides))))


@st.composite
def matrices(draw: st.DrawFn, sampling: Sampling) -> Interval:
    """Any intervals that are not empty; some of them known on one side or not at all."""
    shape, cells = (sampling.rows, sampling.columns), sampling.rows * sampling.columns
    random = np.random.default_rng(draw(st.integers(0, 2**32)))
    sizes = draw(st.sampled_from(SIZES)), draw(st.sampled_from(SIZES))
    with np.errstate(over="ignore"):
        lo = sizes[0] * random.normal(size=shape)
        hi = lo + sizes[1] * random.random(shape) * random.choice((0.0, 1e-3, 1.0), shape)
    lo[random.random(shape) < draw(st.sampled_from((0.0, 0.1, 0.9)))] = -INF
    hi[random.random(shape) < draw(st.sampled_from((0.0, 0.1, 0.9)))] = INF
    for pair in draw(st.lists(st.tuples(ENDS, ENDS), max_size=4)):
        place = np.unravel_index(draw(st.integers(0, cells - 1)), shape)
        lo[place], hi[place] = min(pair), max(pair)
    empty = (lo == INF) | (hi == -INF)
    return Interval(np.where(empty, -INF, lo), np.where(empty, INF, hi))
