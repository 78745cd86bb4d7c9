"""Where taxels sit, and which are neighbours."""

from __future__ import annotations

import numpy as np
import pytest
from eskin_sensor_node.world.skin import CylinderShape, FlatShape, HandShape, Skin
from eskin_sensor_node.world.skin.skin import NO_NEIGHBOUR
from matplotlib.path import Path

SKINS = {
    "flat": FlatShape(shape="flat", rows=5, columns=7, pitch_m=2e-3).build(),
    "cylinder": CylinderShape(shape="cylinder", rows=4, columns=9, pitch_m=2e-3).build(),
    **{f"hand {mm}": HandShape(shape="hand", pitch_mm=mm).build() for mm in (2, 5, 20)},
}


def beside(skin: Skin, number: int) -> set[int]:
    return set(skin.neighbours[number].tolist()) - {NO_NEIGHBOUR}


@pytest.mark.parametrize("name", SKINS)
def test_normals_are_unit_vectors_and_neighbours_are_mutual(name: str) -> None:
    skin = SKINS[name]
    assert np.linalg.norm(skin.normals, axis=1) == pytest.approx(1.0)
    for number in range(len(skin)):
        for other in beside(skin, number):
            assert number in beside(skin, other)
            gap = np.linalg.norm(skin.positions[number] - skin.positions[other])
            assert 0.9 * skin.pitch < gap < 1.01 * skin.pitch


def test_neighbours_are_those_of_brute_force() -> None:
    skin = SKINS["hand 5"]
    apart = np.linalg.norm(skin.positions[:, None] - skin.positions[None], axis=2)
    for number in range(len(skin)):
        near = set(np.flatnonzero(apart[number] <= 1.1 * skin.pitch).tolist()) - {number}
        assert beside(skin, number) == near


def test_grid_has_four_neighbours_inside_and_two_in_a_corner() -> None:
    skin = SKINS["flat"]
    assert beside(skin, 8) == {1, 7, 9, 15}
    assert beside(skin, 0) == {1, 7}


def test_cylinder_closes_around_itself_and_looks_outward() -> None:
    skin = SKINS["cylinder"]
    assert {1, 8} <= beside(skin, 0)
    radial = skin.positions * np.array([1.0, 0.0, 1.0])
    assert np.all(np.einsum("ij,ij->i", radial, skin.normals) > 0.0)


@pytest.mark.parametrize("name", SKINS)
def test_outline_goes_around_all_cells(name: str) -> None:
    skin = SKINS[name]
    inner = 0.499 * skin.pitch * np.array([(-1, -1), (-1, 1), (1, -1), (1, 1)])
    corners = (skin.unrolled[:, None] + inner).reshape(-1, 2)
    line = Path(np.vstack([skin.outline, skin.outline[:1]]), closed=True)
    assert line.contains_points(corners).all()
    # And is that of a hand, not a box.
    width, height = np.ptp(skin.outline, axis=0)
    x, y = np.vstack([skin.outline, skin.outline[:1]]).T
    inside = abs(float(np.sum(x[:-1] * y[1:] - x[1:] * y[:-1]))) / 2.0
    assert skin.area <= inside * 1.000001
    assert inside < (0.85 if name.startswith("hand") else 1.000001) * width * height


def test_hand_is_the_paper_s_84_square_centimetres() -> None:
    hand = HandShape(shape="hand").build()
    assert len(hand) == 8400
    for mm in (1, 2, 4, 5, 10, 20):
        coarse = HandShape(shape="hand", pitch_mm=mm).build()
        assert coarse.area == pytest.approx(84e-4)
        assert len(coarse) == 8400 // mm**2


def test_fingers_bend_and_touch_neither_palm_nor_each_other() -> None:
    hand = SKINS["hand 2"]
    palm, finger = hand.normals[: 40 * 30], hand.normals[40 * 30 :]
    assert np.all(palm == [0.0, 0.0, 1.0])
    assert finger[:, 0].max() > 0.6
    assert finger[:, 0].min() < -0.6
    seen: list[set[int]] = []
    waiting = set(range(len(hand)))
    while waiting:
        part, edge = set[int](), {min(waiting)}
        while edge:
            part |= edge
            edge = set().union(*(beside(hand, number) for number in edge)) - part
        waiting -= part
        seen.append(part)
    assert [len(part) for part in seen] == [1200, 200, 200, 200, 200, 100]


def test_names_have_as_many_digits_as_the_last_needs() -> None:
    assert SKINS["flat"].names[:2] == ("t00", "t01")
    assert HandShape(shape="hand").build().names[-1] == "t8399"
    assert SKINS["flat"].numbers["t34"] == 34


@pytest.mark.parametrize("name", SKINS)
def test_map_lays_neighbours_a_pitch_apart_but_where_it_is_cut(name: str) -> None:
    skin = SKINS[name]
    cut = 0
    for number in range(len(skin)):
        for other in beside(skin, number):
            apart = np.linalg.norm(skin.unrolled[number] - skin.unrolled[other])
            cut += apart != pytest.approx(skin.pitch)
    # A cylinder is cut along one line, from both sides of which each ring's ends see each other.
    assert cut == (2 * 4 if name == "cylinder" else 0)
    assert len(np.unique(skin.unrolled.round(9), axis=0)) == len(skin)


def test_equal_shapes_share_an_immutable_skin() -> None:
    skin = HandShape(shape="hand", pitch_mm=10).build()
    assert HandShape(shape="hand", pitch_mm=10).build() is skin
    assert HandShape(shape="hand", pitch_mm=20).build() is not skin
    for array in (skin.positions, skin.normals, skin.unrolled, skin.neighbours):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0
