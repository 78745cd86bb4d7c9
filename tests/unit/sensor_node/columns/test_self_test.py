"""The self-test of a skin is the firmware's, column by column."""

from __future__ import annotations

from math import inf

import numpy as np
from eskin_sensor_node.columns.self_test import ColumnsSelfTest, nearest
from eskin_sensor_node.firmware.selftest import CERTAIN, SelfTest
from eskin_sensor_node.world.skin.shapes import FlatShape, HandShape
from eskin_sensor_node.world.skin.skin import NO_NEIGHBOUR, Skin
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

SKIN = FlatShape(shape="flat", rows=3, columns=4, pitch_m=1e-3).build()
SHAPE = len(SKIN), 4


def around(skin: Skin) -> list[list[int]]:
    found = nearest(skin.positions, skin.neighbours).tolist()
    return [[k for k in row if k != NO_NEIGHBOUR] for row in found]


bounds = st.sampled_from([-inf, inf, 0.0, 0.5, 1.0, 2.0]) | st.floats(-3.0, 3.0)
samples = st.tuples(arrays(float, SHAPE, elements=bounds), arrays(float, SHAPE, elements=bounds))


@given(st.lists(samples, min_size=1, max_size=3))
@settings(max_examples=150, deadline=None)
def test_verdicts_are_the_firmware_s(windows: list[tuple[np.ndarray, np.ndarray]]) -> None:
    columns = ColumnsSelfTest(SKIN.positions, SKIN.neighbours)
    firmware = SelfTest(around(SKIN))
    for first, second in windows:
        lows, highs = np.minimum(first, second), np.maximum(first, second)
        lows[lows == inf], highs[highs == -inf] = -inf, inf
        columns.take(lows, highs)
        for k in range(SHAPE[0]):
            firmware.take(k, lows[k].tolist(), highs[k].tolist(), SHAPE[1])
        dead, stuck = columns.examine()
        assert list(zip(dead.tolist(), stuck.tolist(), strict=True)) == firmware.examine()


def test_one_that_stays_while_all_around_it_move_is_stuck() -> None:
    columns = ColumnsSelfTest(SKIN.positions, SKIN.neighbours)
    lows = np.tile(np.array([0.0, 9.0, 0.0, 9.0]), (SHAPE[0], 1))
    lows[5] = 3.0
    columns.take(lows, lows + 1.0)
    dead, stuck = columns.examine()
    assert not np.any(dead)
    assert np.flatnonzero(stuck == CERTAIN).tolist() == [5]


def test_the_nearest_four_surround_a_taxel() -> None:
    for skin in (SKIN, HandShape(shape="hand", pitch_mm=5).build()):
        for taxel, found in enumerate(around(skin)):
            far = np.linalg.norm(skin.positions - skin.positions[taxel], axis=1)
            far[taxel] = inf
            assert len(set(found)) == 4
            # Equally near ones may stand for each other.
            assert np.allclose(np.sort(far[found]), np.sort(far)[:4], rtol=1e-6)
