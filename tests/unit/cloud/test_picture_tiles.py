"""Pictures from tiles and compacted rows beside those from the frames that these are made of."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from eskin_cloud.rollup.picture_reading import PictureReader, choose_pictures
from eskin_cloud.store.read.window import Window
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

from tests.support.examples import examples
from tests.unit.cloud.test_patch_tiles import (
    PLAIN,
    SKEWED,
    SPAN,
    START,
    TAXELS,
    TILED,
    carry_out,
    histories,
    samples_of,
)

if TYPE_CHECKING:
    from eskin_cloud.store import Store

    from eskin.wire.frames import Frame

LONGEST_STEP = 240
"""One and a half of the longest period: 40 ns, of which a column has every fourth."""
windows = st.builds(
    lambda start, span: Window(START + start, START + start + span),
    st.integers(-50, SPAN),
    st.integers(1, 2 * SPAN),
)


@settings(
    max_examples=examples(40),
    deadline=None, phases=[Phase.explicit, Phase.generate],
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow,
                           HealthCheck.data_too_large],
)  # fmt: skip
@given(steps=histories(), window=windows, points=st.sampled_from([1, 5, 20, 60]))
def test_pictures_are_those_of_the_frames(
    store: Store, steps: list[list[Frame] | str], window: Window, points: int
) -> None:
    brought = carry_out(store, steps)
    with store.read() as connection:
        reader = PictureReader(connection, TILED, [SKEWED])
        buckets = choose_pictures([reader], window, points)
        found = reader.fold(buckets)
        plain = PictureReader(connection, PLAIN, [SKEWED])
        other = plain.fold(buckets)
        spread = [
            PictureReader(connection, node, [SKEWED], spread=True).fold(buckets)
            for node in (TILED, PLAIN)
        ]
    assert buckets.count <= points
    assert buckets.window.start <= window.start
    assert buckets.window.end >= window.end
    for column, taxel in enumerate(TAXELS):
        lo, hi = np.full(buckets.count, np.inf), np.full(buckets.count, -np.inf)
        for t, low, high in samples_of(brought, taxel):
            picture = (t - buckets.start) // buckets.width
            if 0 <= picture < buckets.count:
                lo[picture], hi[picture] = min(lo[picture], low), max(hi[picture], high)
        assert found.lo[:, column].tolist() == other.lo[:, column].tolist() == lo.tolist()
        assert found.hi[:, column].tolist() == other.hi[:, column].tolist() == hi.tolist()
    # Of a tile it is not kept which of its samples was the greatest.
    assert np.all(found.peak <= other.peak)
    # Where frames of two rates overlap, either may state a gap that the other does not need.
    for column, taxel in enumerate(TAXELS):
        instants = np.array([t for t, _, _ in samples_of(brought, taxel)], np.int64)
        for picture in range(buckets.count):
            begin = buckets.start + picture * buckets.width
            if not np.any((instants >= begin - LONGEST_STEP) & (instants < begin + buckets.width)):
                assert found.gap[picture, column]
                assert other.gap[picture, column]
    assert np.all(found.n >= other.n)
    assert reader.coverage <= plain.coverage
    # A tile belongs to all pictures that one of its samples may lie in.
    for narrow, wide in ((spread[1], spread[0]), (other, spread[1])):
        assert np.all((wide.lo <= narrow.lo) & (wide.hi >= narrow.hi))
        assert np.all(wide.peak <= narrow.peak)
        assert np.all(wide.n >= narrow.n)
    assert np.all(spread[1].gap >= other.gap)
    assert reader.time_error >= plain.time_error
