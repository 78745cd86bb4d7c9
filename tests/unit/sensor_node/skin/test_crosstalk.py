"""What taxels feel of each other, and what of it can be taken back for certain."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from eskin_sensor_node.world.skin import Crosstalk, FlatShape, unmix
from eskin_sensor_node.world.skin.skin import NO_NEIGHBOUR
from hypothesis import given, settings
from hypothesis import strategies as st

from eskin.interval import Interval

if TYPE_CHECKING:
    from eskin.interval import Floats

GRID = FlatShape(shape="flat", rows=4, columns=5, pitch_m=1e-2).build()
ALL = np.arange(len(GRID))


def felt_by_hand(crosstalk: Crosstalk, pressure: Floats) -> list[float]:
    found = []
    for number in range(len(GRID)):
        others = [other for other in GRID.neighbours[number].tolist() if other != NO_NEIGHBOUR]
        mean = sum(float(pressure[other]) for other in others) / len(others)
        found.append(float(pressure[number]) + crosstalk.coefficients[number] * mean)
    return found


def test_felt_is_the_own_pressure_and_a_share_of_the_neighbours_mean() -> None:
    crosstalk = Crosstalk.draw(GRID, 0.3, 5)
    pressure = np.random.default_rng(1).uniform(0.0, 1e4, len(GRID))
    felt = crosstalk.among(ALL).felt(pressure[:, None])
    assert felt[:, 0].tolist() == pytest.approx(felt_by_hand(crosstalk, pressure))


def test_coefficients_stay_within_their_bound_and_differ() -> None:
    found = Crosstalk.draw(GRID, 0.3, 5).coefficients
    assert np.all((found >= 0.0) & (found <= 0.3))
    assert len(np.unique(found)) == len(GRID)
    assert not Crosstalk.draw(GRID, 0.0, 5).coefficients.any()


def test_taxel_without_neighbours_feels_itself_alone() -> None:
    lonely = FlatShape(shape="flat", rows=1, columns=1, pitch_m=1e-2).build()
    crosstalk = Crosstalk.draw(lonely, 0.5, 1)
    assert crosstalk.among(np.array([0])).felt(np.array([[7.0]])).tolist() == [[7.0]]


@settings(max_examples=80, deadline=None, database=None)
@given(st.integers(0, 2**32), st.floats(0.0, 0.5), st.floats(0.0, 50.0))
def test_unmixing_never_loses_the_true_pressures(seed: int, bound: float, error: float) -> None:
    random = np.random.default_rng(seed)
    pressure = random.uniform(0.0, 1e3, (len(GRID), 3)) * (random.random((len(GRID), 3)) < 0.4)
    felt = Crosstalk.draw(GRID, bound, seed).among(ALL).felt(pressure)
    measured = Interval.around(felt + random.uniform(-error, error, felt.shape), error + 1e-9)
    own = unmix(measured, GRID.neighbours, bound=bound, most=1e3)
    assert np.all(own.contains(pressure))


def test_unmixing_separates_a_touch_from_crosstalk() -> None:
    pressure = np.zeros((len(GRID), 1))
    pressure[7] = 1e3
    felt = Crosstalk.draw(GRID, 0.2, 3).among(ALL).felt(pressure)
    own = unmix(Interval.around(felt, 1.0), GRID.neighbours, bound=0.2, most=1e3)
    assert np.flatnonzero(own.inf[:, 0] > 0.0).tolist() == [7]
    # Without the neighbours' tubes a fifth of 1 kPa would stay in doubt.
    assert own.wid[7, 0] < 0.1 * 0.2 * 1e3


def test_broken_taxels_are_not_believed() -> None:
    pressure = np.full((len(GRID), 1), 100.0)
    felt = Crosstalk.draw(GRID, 0.2, 3).among(ALL).felt(pressure)
    felt[7] = 0.0  # stuck at rest
    own = unmix(Interval.around(felt, 1.0), GRID.neighbours, bound=0.2, most=1e3, broken=[7])
    assert np.all(own.contains(pressure))
    assert own.wid[7, 0] >= 1e3
    trusted = unmix(Interval.around(felt, 1.0), GRID.neighbours, bound=0.2, most=1e3)
    assert not np.all(trusted.contains(pressure))


def test_what_no_pressure_explains_leaves_everything_open() -> None:
    felt = Interval.around(np.full((len(GRID), 1), -500.0), 1.0)
    own = unmix(felt, GRID.neighbours, bound=0.2, most=1e3)
    assert np.all(own.equal(Interval(0.0, 1e3)))
