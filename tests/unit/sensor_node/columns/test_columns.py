"""Columns of a skin: samples enclose the truth, at the same instants whatever the cut."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
import pytest
from eskin_sensor_node.firmware.selftest import CERTAIN
from eskin_sensor_node.world.skin.skin import NO_NEIGHBOUR
from hypothesis import given, settings
from hypothesis import strategies as st

from eskin.errors import SettingsError
from eskin.interval import Interval
from eskin.wire.frames import Frame, PatchSamples
from eskin.wire.messages import Position
from tests.unit.sensor_node.columns.skins import columns_of, flat, whole
from tests.unit.sensor_node.designs import SECOND
from tests.unit.sensor_node.designs import settings as node_settings

if TYPE_CHECKING:
    from pathlib import Path

    from eskin_sensor_node.columns import PadColumns, SkinStretch
    from eskin_sensor_node.settings import NodeSettings
    from numpy.typing import NDArray

MILLI = 1_000_000


@pytest.fixture(scope="module")
def small_hand(tmp_path_factory: pytest.TempPathFactory) -> NodeSettings:
    return node_settings(tmp_path_factory.mktemp("node"), "small-hand")


@pytest.fixture(scope="module")
def press(tmp_path_factory: pytest.TempPathFactory) -> NodeSettings:
    return flat(tmp_path_factory.mktemp("flat"), 5, 6)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_every_sample_of_a_scenario_encloses_the_truth(small_hand: NodeSettings, seed: int) -> None:
    columns = columns_of(small_hand, seed=seed, drift=20_000)
    lo, hi, truth = whole(columns, columns.advance(20 * SECOND))
    assert lo.shape == (1000, 336)
    assert np.all((lo <= truth) & (truth <= hi))
    assert np.all(np.isfinite(lo) & np.isfinite(hi))
    # What is pressed is distinguished from what is not.
    threshold = small_hand.skin.threshold_pa
    assert np.count_nonzero(lo > threshold) > 5000
    assert np.count_nonzero((truth <= threshold) & (hi > threshold)) < 0.02 * truth.size
    assert not columns.broken.any()


def test_parts_noise_and_crosstalk_lie_inside_their_tolerances(small_hand: NodeSettings) -> None:
    """Where nothing presses, the same true signal gives different codes, all near each other."""
    columns = columns_of(small_hand)
    codes = columns.sense(np.arange(5) * 20 * MILLI).readings[0].codes["current"]
    at_rest = codes.mean(axis=1)
    assert 1e-4 < at_rest.std() / at_rest.mean() < 1e-2
    assert np.ptp(codes, axis=1).max() <= 3


@given(st.sampled_from([20, 40, 100, 500]), st.integers(0, 5))
@settings(max_examples=8, deadline=None)
def test_samples_do_not_depend_on_how_stretches_are_cut(
    press: NodeSettings, stretch: int, skipped: int
) -> None:
    reference = columns_of(press)
    expected = whole(reference, reference.advance(2 * SECOND))
    section = press.skin.model_copy(update={"stretch_ms": float(stretch)})
    columns = columns_of(press.model_copy(update={"skin": section}))
    lost = columns.skip((skipped - 1) * stretch * MILLI + 1)
    found = whole(columns, columns.advance(2 * SECOND))
    assert lost == skipped * stretch // 20 * 30
    for one, other in zip(expected, found, strict=True):
        assert one[skipped * stretch // 20 :].tobytes() == other.tobytes()


def test_a_boot_draws_other_noise_and_keeps_the_parts(press: NodeSettings) -> None:
    instants = np.arange(200) * 20 * MILLI
    first, again, second = (
        columns_of(press, boot=boot).sense(instants).readings[0].codes["current"]
        for boot in (1, 1, 2)
    )
    assert first.tobytes() == again.tobytes() != second.tobytes()
    assert np.abs(first.mean(axis=1) - second.mean(axis=1)).max() < 0.5
    other = columns_of(press, seed=8).sense(instants).readings[0].codes["current"]
    assert np.abs(first.mean(axis=1) - other.mean(axis=1)).max() > 1.0


def test_stretches_follow_each_other_and_are_due_when_they_are_complete(
    press: NodeSettings,
) -> None:
    columns = columns_of(press)
    assert columns.next_due == 100 * MILLI
    assert list(columns.advance(100 * MILLI - 1)) == []
    found = list(columns.advance(350 * MILLI))
    assert [(each.begin, each.end) for each in found] == [
        (k * 100 * MILLI, (k + 1) * 100 * MILLI) for k in range(3)
    ]
    assert [each.grids[0][:4] for each in found] == [(0, 20 * MILLI, 5 * k, 5) for k in range(3)]
    assert columns.skip(300 * MILLI) == 0
    assert columns.skip(300 * MILLI + 1) == 5 * 30
    assert columns.next_due == 500 * MILLI


def frames(columns: PadColumns, stretch: SkinStretch) -> list[Frame]:
    """Each page of a stretch as a frame that its layout reads."""
    found = []
    for page in range(len(columns.layout.pages)):
        numbers = columns.layout.page_range(page)
        patches = tuple(
            PatchSamples.pack(
                Interval(each.lo, each.hi),
                columns.patches[each.patch].least_width,
                patch=each.patch,
                grid=each.grid,
                first_row=stretch.grids[each.grid].first_row,
            )
            for each in stretch.patches
            if each.patch in numbers
        )
        frame = Frame(
            Position(0, page),
            columns.layout.content_hash,
            page,
            stretch.begin,
            (stretch.begin, stretch.end),
            tuple(stretch.grids),
            patches,
        )
        frame.require_layout(columns.layout, columns.patches)
        found.append(frame)
    return found


def test_another_rate_changes_no_layout_and_fits_its_pages(small_hand: NodeSettings) -> None:
    columns = columns_of(small_hand)
    layout = columns.layout.content_hash
    stretches = list(columns.advance(200 * MILLI))
    for period in (5 * MILLI, 40 * MILLI, 300 * MILLI):
        columns.sample_every(period)
        stretches += [next(columns.advance(columns.next_due)) for _ in range(2)]
    assert columns.layout.content_hash == layout
    assert [each.grids[0].rows for each in stretches] == [5, 5, 5, 5, 2, 2, 1, 1]
    for one, other in pairwise(stretches):
        assert one.end == other.begin == one.begin + one.grids[0].rows * one.grids[0].period
        assert other.grids[0].first_row == one.grids[0].first_row + one.grids[0].rows
    for each in stretches:
        for frame in frames(columns, each):
            for packed, values in zip(frame.patches, frame.values, strict=True):
                truth = each.patches[packed.patch].truth
                assert np.all((values.inf <= truth) & (truth <= values.sup))


def test_nodes_of_one_skin_agree_and_know_less_at_their_seams(tmp_path: Path) -> None:
    def share(name: str, names: tuple[str, ...]) -> PadColumns:
        return columns_of(flat(tmp_path, 16, 17, node=name, controllers=names))

    names = ("n1", "n2", "n3", "n4")
    one = share("n1", ("n1",))
    expected = whole(one, one.advance(2 * SECOND))
    at = {name: k for k, name in enumerate(sorted(one.columns))}
    skin = flat(tmp_path, 16, 17).skin.skin
    owner: dict[str, str] = {}
    wider = np.zeros(len(at), np.bool_)
    for name in names:
        columns = share(name, names)
        owner |= dict.fromkeys(columns.columns, name)
        lo, hi, truth = whole(columns, columns.advance(2 * SECOND))
        own = [at[taxel] for taxel in sorted(columns.columns)]
        assert truth.tobytes() == expected[2][:, own].tobytes()
        assert np.all((lo <= truth) & (truth <= hi))
        assert np.all((lo <= expected[0][:, own]) & (hi >= expected[1][:, own]))
        wider[own] = np.any((lo < expected[0][:, own]) | (hi > expected[1][:, own]), axis=0)
    assert owner.keys() == at.keys()
    seams = {
        taxel
        for taxel in at
        for other in skin.neighbours[skin.numbers[taxel]].tolist()
        if other != NO_NEIGHBOUR and owner[skin.names[other]] != owner[taxel]
    }
    assert np.count_nonzero(wider) > 0
    assert {taxel for taxel, k in at.items() if wider[k]} <= seams


FAULTS = """
[[fault]]
taxel = "t24"
kind = "dead"
[[fault]]
taxel = "t15"
kind = "stuck"
"""
"""A corner, and the middle, which is pressed."""


def test_broken_taxels_are_found_reported_unknown_and_not_trusted(tmp_path: Path) -> None:
    columns = columns_of(flat(tmp_path, 5, 6, faults=FAULTS))
    names = sorted(columns.columns)
    broken = np.array([name in {"t24", "t15"} for name in names])

    def window(end: int) -> tuple[dict[str, tuple[int, int]], NDArray[np.bool_]]:
        lo, hi, truth = whole(columns, columns.advance(end * SECOND))
        # Their neighbours are enclosed throughout: one of each may be stuck.
        assert np.all((lo <= truth) & (truth <= hi) | broken)
        found = {fault.taxel: fault[1:] for fault in columns.examine()}
        return found, np.isinf(lo) & np.isinf(hi)

    found, unknown = window(3)
    assert (found["t24"][0], found["t15"][1]) == (CERTAIN, CERTAIN)
    assert [columns.columns[k] for k in np.flatnonzero(columns.broken)] == ["t15", "t24"]
    assert not unknown[:, names.index("t15")].any()
    # They stay so while no window shows that they are sound.
    for end in (4, 6):
        found, unknown = window(end)
        assert (found["t24"][0], found["t15"][1]) == (CERTAIN, CERTAIN)
        assert unknown[:, broken].all()
        assert not unknown[:, ~broken].any()


def test_more_controllers_than_patches_are_refused(tmp_path: Path) -> None:
    node = flat(tmp_path, 5, 6, controllers=("small-hand", "n2"))
    with pytest.raises(SettingsError, match=r"skin\.controllers"):
        columns_of(node)
