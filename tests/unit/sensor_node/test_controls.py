"""Commands take effect on a real node, whole or not at all, and survive a restart."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

import pytest
from eskin_sensor_node.node.commands import NodeControls

from eskin.errors import CommandError
from tests.unit.sensor_node.designs import SECOND, START, Bench
from tests.unit.sensor_node.messages import (
    assert_truth_is_inside,
    decode,
    frames_of,
    peaks_of,
    samples_of,
)

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from eskin.wire.messages.command import Arguments, State


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Bench]:
    made = Bench(tmp_path)
    yield made
    made.close()


@pytest.fixture
def controls(bench: Bench) -> NodeControls:
    return NodeControls(bench.node)


def periods(bench: Bench) -> dict[str, set[int]]:
    found: dict[str, set[int]] = {}
    for each in samples_of(bench):
        found.setdefault(each.channel.partition(".")[0], set()).add(each.tube.dt)
    return found


def test_setting_one_taxel_leaves_the_others(bench: Bench, controls: NodeControls) -> None:
    state = controls.apply("set", {"rate": 125.0, "mode": "samples", "taxel": "t02"})
    assert state["t02"] == {
        "adaptive": "off",
        "gain": 1.0,
        "smoothing": 0.0,
        "rate": 125.0,
        "mode": "samples",
    }
    assert state["t01"]["rate"] == 1000.0
    bench.run_to(2.0)
    assert periods(bench) == {"t01": {SECOND // 1000}, "t02": {SECOND // 125}, "t03": {10**6}}
    assert_truth_is_inside(samples_of(bench))


@pytest.mark.parametrize("rate", [250.0, 1000.0 / 2**6])
def test_column_with_a_part_of_the_rate_holds_its_truth_until_a_reset(
    bench: Bench, controls: NodeControls, rate: float
) -> None:
    period = round(SECOND / rate)
    bench.run_to(0.53)
    controls.apply("set", {"rate": rate, "taxel": "t02"})
    bench.run_to(1.07)
    controls.apply("reset", {"taxel": "t02"})
    bench.run_to(1.6)
    assert any(p.strides for frame in frames_of(bench.bodies()) for p in frame.patches)
    for taxel in ("t01", "t02"):
        found = samples_of(bench, f"{taxel}.capacitance")
        assert_truth_is_inside(found)
        instants = [
            each.ticks + k * each.tube.dt
            for each in found
            for k in range(len(each.tube.values.inf))
        ]
        steps = {later - earlier for earlier, later in pairwise(instants)}
        if taxel == "t01":
            assert steps == {SECOND // 1000}
        else:
            # It changes its rate at a whole multiple of the new period.
            assert min(steps) == SECOND // 1000
            assert period <= max(steps) <= 2 * period
            slow = [each for each in found if each.tube.dt == period]
            assert slow
            assert all(each.ticks % period == 0 for each in slow)


@pytest.mark.parametrize("rate", [300.0, 999.0, 400.0, 1000.0 / 2**17])
def test_taxel_of_a_patch_at_no_power_of_two_is_refused(
    controls: NodeControls, rate: float
) -> None:
    before = controls.restore({})
    with pytest.raises(CommandError, match="power of two") as caught:
        controls.apply("set", {"rate": rate, "taxel": "t02"})
    assert (caught.value.field, caught.value.value) == ("rate", rate)
    assert controls.restore({}) == before
    # All of them together have one rate, and a state that no more fits is left out.
    assert controls.apply("set", {"rate": 300.0})["t03"]["rate"] == pytest.approx(300.0, rel=1e-6)
    assert controls.apply("reset", {}) == before
    assert controls.restore({"t02": {"rate": rate}}) == before


def test_all_taxels_are_set_at_once_and_reset(bench: Bench, controls: NodeControls) -> None:
    designed = controls.restore({})
    controls.apply("set", {"gain": 2.0, "smoothing": 0.5, "mode": "peaks"})
    state = controls.apply("set", {"threshold": 5e-12, "channel": "t01.capacitance"})
    assert [state[name]["gain"] for name in ("t01", "t02", "t03")] == [2.0, 2.0, 2.0]
    assert state["t01.capacitance"] == {"threshold": 5e-12}
    assert controls.apply("reset", {}) == designed
    bench.run_to(1.0)
    assert set(periods(bench)) == {"t01", "t02", "t03"}


@pytest.mark.parametrize(
    ("arguments", "allowed"),
    [
        ({"rate": 2000.0}, "at most 1000"),
        ({"gain": 2.0, "taxel": "t09"}, "t01, t02, t03"),
        ({"threshold": 1.0, "channel": "t01.area"}, "t01.capacitance, t01.current"),
    ],
)
def test_refused_command_names_what_is_allowed_and_changes_nothing(
    controls: NodeControls, arguments: dict[str, float | str], allowed: str
) -> None:
    before = controls.restore({})
    with pytest.raises(CommandError, match=allowed):
        controls.apply("set", arguments)
    assert controls.restore({}) == before


def test_state_is_taken_up_again_at_the_next_start(
    controls: NodeControls, tmp_path_factory: pytest.TempPathFactory
) -> None:
    controls.apply("set", {"rate": 200.0, "gain": 1.5, "smoothing": 0.25, "mode": "adaptive"})
    state = controls.apply("set", {"threshold": 9e-12, "channel": "t03.capacitance"})
    again = Bench(tmp_path_factory.mktemp("again"))
    assert NodeControls(again.node).restore(state) == state
    again.run_to(1.0)
    again.close()


def test_state_that_does_not_fit_any_more_is_left_out(controls: NodeControls) -> None:
    before = controls.restore({})
    gone: State = {
        "t09": {"gain": 2.0},
        "t01": {"rate": 1e6, "mode": "odd"},
        "t01.area": {"x": 1.0},
    }
    assert controls.restore(gone) == before


def test_setting_between_frames_loses_no_message(bench: Bench, controls: NodeControls) -> None:
    bench.run_to(2.3)
    controls.apply("set", {"smoothing": 0.5})
    bench.run_to(4.0)
    sequences = [decode(body).position.sequence for body in bench.bodies()]
    assert sequences == list(range(len(sequences)))


@pytest.mark.parametrize(
    "arguments",
    [
        {"threshold": 20e-12, "channel": "t01.capacitance"},
        {"gain": 0.5},
        {"smoothing": 0.25},
        {"rate": 500.0},
    ],
)
def test_peaks_after_a_command_have_their_own_time(
    bench: Bench, controls: NodeControls, arguments: Arguments
) -> None:
    bench.run_to(2.0)
    before = len(peaks_of(bench))
    controls.apply("set", arguments)
    bench.run_to(3.5)
    peaks = peaks_of(bench)[before:]
    assert {peak.channel for peak in peaks} >= {"t01.capacitance", "t02.capacitance"}
    # A peak that was under way before is stated then, too: half a period back, at most.
    assert all(START + 1.7 * SECOND < peak.time[0] < peak.time[1] for peak in peaks)
    assert all(peak.time[1] < START + 3.6 * SECOND for peak in peaks)
