"""A block reduced to a number of entries, each the hull of its samples."""

from __future__ import annotations

import numpy as np
import pytest
from eskin_cloud.live.sse_encoder import reduce_block

from eskin.wire.messages import Block
from tests.unit.cloud.messages import DT, NODE, START, stretch


@pytest.mark.parametrize(("grain", "least"), [(0, 1), (DT, 1), (7 * DT, 7), (10**18, 500)])
def test_entries_are_as_long_as_they_may_be_and_no_longer_than_twice(
    grain: int, least: int
) -> None:
    series = reduce_block(NODE, stretch(0, [1.0] * 500, [2.0] * 500), 1000, grain)
    assert least <= series.dt // DT <= max(1, 2 * least)
    assert len(series.t) == -(-500 * DT // series.dt)
    few = reduce_block(NODE, stretch(0, [1.0] * 500, [2.0] * 500), 5, grain)
    assert len(few.t) <= 5


@pytest.mark.parametrize("points", [1, 7, 50, 499, 500, 1000])
def test_reduced_block_is_the_hull_of_its_samples(points: int) -> None:
    draw = np.random.default_rng(points)
    lo = draw.normal(size=500)
    said = stretch(0, lo, lo + draw.random(500), time=(START, START + 7), coverage=0.999)
    series = reduce_block(NODE, Block.decode(said.encode()), points)
    assert len(series.t) <= points
    assert len(series.t) * series.dt == 500 * said.tube.dt, "the last one claims nobody else's time"
    moments = said.tube.moments - series.t0
    for t, low, high in zip(series.t, series.lo, series.hi, strict=True):
        inside = (moments >= t) & (moments < t + series.dt)
        assert low == said.tube.values.inf[inside].min()
        assert high == said.tube.values.sup[inside].max()
    assert series.resolution == ("sample" if points >= 500 else "hull")
    assert series.coverage <= 0.999
