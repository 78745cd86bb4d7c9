"""A skin and its bounds are checked before contacts are sought."""

from __future__ import annotations

from math import inf, nan
from typing import Any

import numpy as np
import pytest

from eskin.contacts import Skin, find_contacts
from eskin.errors import ContactError, IntervalError

SQUARE = [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)]
STARTS, NEIGHBOURS = [0, 2, 4, 6, 8], [1, 2, 0, 3, 0, 3, 1, 2]


class WithUnit(float):
    units = "Pa"


def test_grid_lists_the_neighbours_of_each_taxel() -> None:
    skin = Skin.grid(2, 3, pitch=0.5, area=[1.0, 2.0, 3.0, 4.0, 5.0, 6.0])
    lists = [
        sorted(skin.neighbours[skin.starts[k] : skin.starts[k + 1]].tolist()) for k in range(6)
    ]
    assert lists == [[1, 3], [0, 2, 4], [1, 5], [0, 4], [1, 3, 5], [2, 4]]
    assert skin.positions.tolist()[4] == [0.5, 0.5]
    assert skin.area[5] == 6.0
    assert (len(skin), skin.dimensions) == (6, 2)


def test_lists_and_edges_describe_the_same_skin() -> None:
    one = Skin(SQUARE, 1e-5, STARTS, NEIGHBOURS)  # type: ignore[arg-type]
    two = Skin.from_edges(SQUARE, [1e-5] * 4, [(1, 0), (2, 3), (0, 2), (1, 3)])
    for name in ("positions", "area", "starts", "neighbours"):
        assert np.array_equal(getattr(one, name), getattr(two, name))


def test_skin_keeps_its_own_arrays() -> None:
    area = np.full(4, 1e-5)
    skin = Skin.from_edges(SQUARE, area, [])
    area[:] = -1.0
    assert np.all(skin.area == 1e-5)


@pytest.mark.parametrize(
    ("change", "value"),
    [
        ("positions", [0.0, 1.0, 2.0, 3.0]),
        ("positions", np.zeros((4, 4))),
        ("positions", [(0.0, 0.0), (1.0, nan), (0.0, 1.0), (1.0, 1.0)]),
        ("area", [1e-5] * 3),
        ("area", -1e-5),
        ("area", [1e-5, 1e-5, 0.0, 1e-5]),
        ("area", [1e-5, 1e-5, inf, 1e-5]),
        ("area", WithUnit(1e-5)),
        ("starts", [0, 2, 4, 6]),
        ("starts", [1, 2, 4, 6, 8]),
        ("starts", [0, 2, 4, 6, 7]),
        ("starts", [0, 4, 2, 6, 8]),
        ("starts", [0.0, 2.0, 4.0, 6.0, 8.0]),
        ("neighbours", [1, 2, 0, 3, 0, 3, 1, 4]),
        ("neighbours", [1, 2, 0, 3, 0, 3, 1, -1]),
        ("neighbours", [1, 2, 0, 3, 0, 3, 1, 3]),
        ("neighbours", [1, 2, 0, 3, 0, 3, 1, 1]),
        ("neighbours", [1, 2, 0, 3, 0, 3, 1, 0]),
    ],
)
def test_skin_that_does_not_fit_is_rejected(change: str, value: Any) -> None:
    parts: dict[str, Any] = {"positions": SQUARE, "area": 1e-5}
    parts |= {"starts": STARTS, "neighbours": NEIGHBOURS}
    with pytest.raises(ContactError):
        Skin(**(parts | {change: value}))


@pytest.mark.parametrize(
    "edges", [[(0, 4)], [(-1, 0)], [(1, 1)], [(0, 1), (1, 0)], [(0, 1, 2)], [(0.0, 1.0)], [0, 1]]
)
def test_edges_that_are_no_pairs_of_taxels_are_rejected(edges: Any) -> None:
    with pytest.raises(ContactError):
        Skin.from_edges(SQUARE, 1e-5, edges)


@pytest.mark.parametrize(
    ("rows", "columns", "pitch"), [(0, 2, 1.0), (2, 0, 1.0), (2, 2, 0.0), (2, 2, nan), (2, 2, inf)]
)
def test_grid_without_taxels_is_rejected(rows: int, columns: int, pitch: float) -> None:
    with pytest.raises(ContactError):
        Skin.grid(rows, columns, pitch=pitch, area=1e-5)


@pytest.mark.parametrize(
    ("lo", "hi"),
    [
        ([0.0] * 3, [1.0] * 3),
        ([[0.0] * 4], [[1.0] * 4]),
        ([0.0] * 4, [1.0] * 3),
        ([0.0, 2.0, 0.0, 0.0], [1.0] * 4),
        ([inf, 0.0, 0.0, 0.0], [inf, 1.0, 1.0, 1.0]),
        ([-inf, 0.0, 0.0, 0.0], [-inf, 1.0, 1.0, 1.0]),
        (["a"] * 4, [1.0] * 4),
    ],
)
def test_bounds_that_are_no_pressures_are_rejected(lo: Any, hi: Any) -> None:
    skin = Skin.from_edges(SQUARE, 1e-5, [(0, 1)])
    with pytest.raises(IntervalError):
        find_contacts(lo, hi, skin, 1000.0)


def test_threshold_with_a_unit_is_rejected() -> None:
    skin = Skin.from_edges(SQUARE, 1e-5, [])
    with pytest.raises(ContactError):
        find_contacts([0.0] * 4, [1.0] * 4, skin, WithUnit(1000.0))


def test_bounds_may_be_strided_short_or_read_only() -> None:
    skin = Skin.from_edges(SQUARE, 1e-5, [(0, 1)])
    lo = np.array([1500.0, 0.0, 1500.0, 0.0], np.float32)
    hi = np.repeat(lo.astype(float) + 1.0, 2)[::2]
    hi.flags.writeable = False
    assert find_contacts(lo, hi, skin, 1000.0).core_of.tolist() == [0, -1, 1, -1]
