"""Descriptions of skins: patches, pages, neighbours, controllers."""

from __future__ import annotations

import numpy as np
import pytest
from eskin_sensor_node.columns.plan import PatchQuantity, SkinPlan, plan_skin
from eskin_sensor_node.world.skin.shapes import CylinderShape, FlatShape, HandShape, Shape
from eskin_sensor_node.world.skin.skin import NO_NEIGHBOUR, Skin
from hypothesis import given, settings
from hypothesis import strategies as st

from eskin.errors import SettingsError
from eskin.interval import Interval
from eskin.wire.frames import Frame, Grid, Layout, Patch, PatchSamples
from eskin.wire.frames.frame import frame_limit
from eskin.wire.messages import Position

PRESSURE = PatchQuantity("pressure", "Pa", 900.0, 3000.0)
HAND = HandShape(shape="hand", pitch_mm=1).build()

shapes = st.one_of(
    st.builds(HandShape, shape=st.just("hand"), pitch_mm=st.sampled_from([2, 4, 5, 10, 20])),
    st.builds(
        FlatShape,
        shape=st.just("flat"),
        rows=st.integers(1, 40),
        columns=st.integers(1, 40),
        pitch_m=st.just(1e-3),
    ),
    st.builds(
        CylinderShape,
        shape=st.just("cylinder"),
        rows=st.integers(1, 20),
        columns=st.integers(3, 40),
        pitch_m=st.just(2e-3),
    ),
)


def planned(skin: Skin, rows: int = 5, nodes: int = 0, node: str = "n0") -> SkinPlan:
    controllers = tuple(f"n{k}" for k in range(nodes))
    return plan_skin(skin, PRESSURE, rows=rows, controllers=controllers, node=node)


def described_pairs(plan: SkinPlan) -> list[frozenset[str]]:
    """Names of all neighbours that patches and seams state."""
    names = [patch.taxels for patch in plan.patches]
    inside = [
        frozenset((names[k][a], names[k][b]))
        for k, patch in enumerate(plan.patches)
        for a, b in patch.neighbours
    ]
    return inside + [
        frozenset((names[seam.first][a], names[seam.second][b]))
        for seam in plan.layout.seams
        for a, b in seam.pairs
    ]


@given(shapes, st.integers(0, 6))
@settings(max_examples=40, deadline=None)
def test_a_plan_describes_each_taxel_and_each_pair_once(shape: Shape, nodes: int) -> None:
    skin = shape.build()
    try:
        plan = planned(skin, nodes=nodes)
    except SettingsError:
        assert nodes > -(-len(skin) // 64)
        return
    plan.layout.require_patches(plan.patches)
    assert Layout.decode(plan.layout.encode()) == plan.layout
    assert [Patch.decode(patch.encode()) for patch in plan.patches] == list(plan.patches)
    taxels = [name for patch in plan.patches for name in patch.taxels]
    assert sorted(taxels) == sorted(skin.names)
    pairs = described_pairs(plan)
    assert len(set(pairs)) == len(pairs)
    assert set(pairs) == {
        frozenset((skin.names[k], skin.names[other]))
        for k, around in enumerate(skin.neighbours.tolist())
        for other in around
        if other != NO_NEIGHBOUR
    }
    micro = skin.pitch * 1e6
    for patch in plan.patches:
        x, y = (np.array(axis) for axis in patch.positions)
        assert max(np.ptp(x), np.ptp(y)) <= 7.5 * micro
        assert patch.cell_area == skin.cell_area


def test_the_paper_s_hand_has_compact_patches_and_few_pages() -> None:
    plan = planned(HAND)
    assert sum(len(each) for each in plan.tiles) == 8400
    # Finger tips and edges need not fill their tiles, most do: 132 could not be fewer.
    assert 132 <= len(plan.patches) <= 160
    assert len(plan.layout.pages) == 4
    assert len(plan.layout.encode()) < 65_536


@pytest.mark.parametrize("rows", [1, 5, 10, 100])
def test_pages_hold_frames_of_any_samples(rows: int) -> None:
    plan = planned(HAND, rows=rows)
    random = np.random.default_rng(rows)
    grid = Grid(0, 20_000_000, 0, rows, 1.0)
    for page in range(len(plan.layout.pages)):
        numbers = plan.layout.page_range(page)
        patches = []
        for number in numbers:
            lo = random.normal(0.0, 1e9, (rows, len(plan.tiles[number])))
            values = Interval(lo, lo + random.exponential(1e9, lo.shape))
            patches.append(PatchSamples.pack(values, 900.0, patch=number, grid=0, first_row=0))
        frame = Frame(
            Position(0, page), plan.layout.content_hash, page, 0, (0, 1), (grid,), tuple(patches)
        )
        frame.require_layout(plan.layout, plan.patches)
        sizes = [len(plan.tiles[k]) for k in numbers]
        assert len(frame.encode()) <= frame.limit == frame_limit(sizes, rows) <= 65_536


@pytest.mark.nightly
def test_four_controllers_share_a_hand_evenly() -> None:
    shares = [planned(HAND, nodes=4, node=f"n{k}") for k in range(4)]
    assert len({plan.layout.content_hash for plan in shares}) == 1
    layout = shares[0].layout
    assert [each.node for each in layout.controllers] == ["n0", "n1", "n2", "n3"]
    first = 0
    for plan, controller in zip(shares, layout.controllers, strict=True):
        pages = range(first, first + controller.pages)
        assert [k for page in pages for k in layout.page_range(page)] == list(plan.own)
        assert abs(sum(len(plan.tiles[k]) for k in plan.own) - 2100) <= 64
        first += controller.pages


def test_too_many_controllers_and_too_long_stretches_are_refused() -> None:
    small = FlatShape(shape="flat", rows=8, columns=8, pitch_m=1e-3).build()
    with pytest.raises(SettingsError, match=r"skin\.controllers"):
        planned(small, nodes=2)
    with pytest.raises(SettingsError, match=r"skin\.stretch_ms"):
        planned(small, rows=1000)
