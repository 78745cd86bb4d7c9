"""Stuck and dead taxels are found from what was measured, and healthy ones are never accused."""

from __future__ import annotations

import numpy as np
import pytest

from eskin.interval import Interval
from sensor_node.skin import FlatShape, examine

GRID = FlatShape(shape="flat", rows=3, columns=3, pitch_m=1e-2).build()
MIDDLE = 4


def tubes(stuck: tuple[int, ...] = (), size: float = 1.0, width: float = 0.1) -> Interval:
    """All swing alike, but for the stuck ones."""
    swing = size * np.sin(np.linspace(0.0, 6.0, 200))
    values = np.tile(swing, (len(GRID), 1))
    values[list(stuck)] = 0.3
    random = np.random.default_rng(2)
    return Interval.around(values + random.uniform(-width / 2, width / 2, values.shape), width / 2)


def test_taxel_that_stays_while_all_around_it_move_is_certainly_stuck() -> None:
    health = examine(tubes((MIDDLE,)), GRID.neighbours, still=0.25, moves=0.5)
    assert np.flatnonzero(health.stuck.certain).tolist() == [MIDDLE]
    assert np.all(np.delete(health.stuck.impossible, MIDDLE))
    assert np.all(health.dead.impossible)


def test_nothing_is_certain_where_the_neighbours_do_not_certainly_move() -> None:
    calm = examine(tubes(tuple(range(9))), GRID.neighbours, still=0.25, moves=0.5)
    assert not calm.stuck.certain.any()
    assert calm.stuck.possible.all()


def test_one_neighbour_that_stays_is_enough_for_doubt() -> None:
    health = examine(tubes((MIDDLE, 1)), GRID.neighbours, still=0.25, moves=0.5)
    assert not health.stuck.certain[MIDDLE]
    assert health.stuck.possible[MIDDLE]


def test_wide_tube_is_never_certainly_constant() -> None:
    health = examine(tubes((MIDDLE,), size=2.0, width=0.4), GRID.neighbours, still=0.25, moves=0.5)
    assert health.stuck.possible[MIDDLE]


@pytest.mark.parametrize("side", ["lo", "hi", "both"])
def test_saturated_taxel_is_dead(side: str) -> None:
    values = tubes()
    lo, hi = values.inf.copy(), values.sup.copy()
    if side != "hi":
        lo[2] = -np.inf
    if side != "lo":
        hi[2] = np.inf
    health = examine(Interval(lo, hi), GRID.neighbours, still=0.25, moves=0.5)
    assert np.flatnonzero(health.dead.certain).tolist() == [2]
    assert not health.stuck.certain[2]


def test_taxel_that_saturates_at_times_is_possibly_dead_and_not_constant() -> None:
    values = tubes((MIDDLE,))
    hi = values.sup.copy()
    hi[MIDDLE, 10:20] = np.inf
    health = examine(Interval(values.inf, hi), GRID.neighbours, still=0.25, moves=0.5)
    assert health.dead.possible[MIDDLE]
    assert health.stuck.possible[MIDDLE]
    assert health.moved.sup[MIDDLE] == np.inf


def test_dead_neighbours_are_passed_over() -> None:
    values = tubes((MIDDLE,))
    hi = values.sup.copy()
    hi[1] = np.inf
    health = examine(Interval(values.inf, hi), GRID.neighbours, still=0.25, moves=0.5)
    assert health.stuck.certain[MIDDLE]
    hi[[3, 5, 7]] = np.inf
    alone = examine(Interval(values.inf, hi), GRID.neighbours, still=0.25, moves=0.5)
    assert not alone.stuck.certain[MIDDLE]


def test_movement_encloses_the_range_of_every_signal_in_the_tube() -> None:
    random = np.random.default_rng(4)
    values = random.normal(size=(9, 50))
    error = random.uniform(0.0, 0.5, (9, 50))
    centre = values + random.uniform(-1.0, 1.0, values.shape) * error
    moved = examine(Interval.around(centre, error), GRID.neighbours, still=1.0, moves=1.0).moved
    assert np.all(moved.contains(np.ptp(values, axis=1)))
