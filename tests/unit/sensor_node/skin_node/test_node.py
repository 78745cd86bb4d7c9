"""A node of a large skin writes frames that enclose the truth, and states what is missing."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from eskin_sensor_node.firmware import states
from eskin_sensor_node.firmware.gap_reasons import ASLEEP, DEAD, FAILED, FULL, OVERRUN, TEXTS
from eskin_sensor_node.machine.machine import START_UP

from eskin.errors import CommandError, FlashError
from eskin.interval import Verdict
from eskin.wire.messages import Position, ResetCause, Status
from tests.unit.sensor_node.designs import SECOND
from tests.unit.sensor_node.skin_node.benches import LAYOUT, PATCHES, STRETCH, SkinBench

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from eskin.wire.frames import Frame
    from eskin.wire.messages.command import Arguments

SAMPLES = 4 * 5 + 1
"""Of a stretch."""


@pytest.fixture
def bench(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[SkinBench]:
    made = SkinBench(tmp_path, **getattr(request, "param", {}))
    yield made
    made.close()


def last_instant(frame: Frame) -> int:
    """From a frame's first instant to its last sample, ns."""
    return max(
        grid.delay + (grid.rows - 1) * grid.period + max(PATCHES[each.patch].skew or (0,))
        for each in frame.patches
        for grid in [frame.grids[each.grid]]
    )


def test_each_page_of_each_stretch_is_one_frame_that_encloses_the_truth(bench: SkinBench) -> None:
    bench.run_to(3.0)
    frames, truths = bench.frames(), bench.truths()
    assert [frame.page for frame in frames] == [0, 1] * 30
    assert [frame.position for frame in frames] == [Position(1, k) for k in range(60)]
    for frame in frames:
        frame.require_layout(LAYOUT, PATCHES)
        truth, last = truths[frame.position], last_instant(frame)
        assert frame.time[0] <= truth.time <= frame.time[1]
        assert frame.time[0] + last <= bench.clock.true_time(frame.ticks + last)
        assert bench.clock.true_time(frame.ticks + last) <= frame.time[1] + last
        lows = np.concatenate([values.inf.ravel() for values in frame.values])
        highs = np.concatenate([values.sup.ravel() for values in frame.values])
        assert len(truth.values) == len(lows)
        assert np.all((lows <= truth.values) & (truth.values <= highs))
    assert any(np.isneginf(values.inf).any() for frame in frames for values in frame.values)
    grids = [frame.grids[-1] for frame in frames if frame.page == 0]
    assert all(b.first_row == a.first_row + a.rows for a, b in pairwise(grids))
    assert {len(frame.grids) for frame in frames} == {1, 2}


def test_status_names_the_profile(bench: SkinBench) -> None:
    bench.run_to(0.5)
    bench.node.record_status()
    status = Status.decode(bench.waiting()[-1].body)
    assert status.profile == "paper-hand"


def test_descriptions_are_kept_before_the_first_frame(bench: SkinBench) -> None:
    kept = [bench.outbox.description(name) for name in bench.outbox.descriptions()]
    assert kept == [LAYOUT.encode(), *(patch.encode() for patch in PATCHES)]


def test_overrun_is_a_gap_and_nothing_is_sampled_twice(bench: SkinBench) -> None:
    bench.run_to(1.0)
    bench.ticks = 5 * SECOND
    bench.node.advance(bench.ticks)
    bench.run_to(6.0)
    (statement,) = bench.statements()
    (gap,) = statement.gaps
    assert (gap.reason, gap.messages, gap.patches) == (TEXTS[OVERRUN], 0, ())
    assert gap.samples == 40 * SAMPLES
    assert gap.time[0] <= bench.clock.true_time(SECOND)
    assert gap.time[1] >= bench.clock.true_time(5 * SECOND)
    assert gap.time[1] - gap.time[0] < 4 * SECOND + SECOND // 100
    ticks = [frame.ticks for frame in bench.frames() if frame.page == 0]
    assert ticks == [k * STRETCH for k in range(60) if not 10 <= k < 50]


def test_reset_is_a_gap_and_the_next_boot_goes_on(bench: SkinBench) -> None:
    bench.run_to(1.05)
    bench.node.machine.reset(ResetCause.WATCHDOG)
    bench.run_to(2.0)
    (statement,) = bench.statements()
    (gap,) = statement.gaps
    assert statement.position == Position(2, 0)
    assert gap.reason == "watchdog reset"
    assert gap.samples == SAMPLES
    again = [frame for frame in bench.frames() if frame.position.boot == 2]
    assert [frame.ticks for frame in again[:3:2]] == [0, STRETCH]
    for frame in again:
        truth = bench.truths()[frame.position]
        assert frame.time[0] <= truth.time <= frame.time[1]
    restarted = bench.clock.true_time(0)
    assert gap.time[0] <= restarted - START_UP <= restarted <= gap.time[1]


def test_failed_commit_is_a_gap_and_sampling_goes_on(
    bench: SkinBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    bench.run_to(0.5)

    def fail(_: object) -> None:
        raise FlashError("worn out")

    with monkeypatch.context() as patched:
        patched.setattr(type(bench.flash), "commit", fail)
        bench.run_to(1.0)
    bench.run_to(1.5)
    (statement,) = bench.statements()
    (gap,) = statement.gaps
    assert (gap.reason, gap.messages, gap.samples) == (TEXTS[FAILED], 10, 5 * SAMPLES)
    assert len(bench.frames()) == 20
    # The attempts to state it took numbers as well.
    lost = {n for _, first, last in gap.lost for n in range(first, last + 1)}
    kept = {each.position[1] for each in bench.waiting()}
    assert lost.isdisjoint(kept)
    assert lost | kept == set(range(max(kept) + 1))


def test_full_flash_gives_up_frames_and_keeps_statements(tmp_path: Path) -> None:
    flash = {"path": tmp_path / "flash.sqlite", "capacity_bytes": 2**16}
    bench = SkinBench(tmp_path, flash=flash)
    bench.node.record_status()
    bench.run_to(1.0)
    bench.ticks = 5 * SECOND
    bench.node.advance(bench.ticks)
    bench.run_to(60.0)
    reasons = [gap.reason for each in bench.statements() for gap in each.gaps]
    assert reasons == [TEXTS[OVERRUN], TEXTS[FULL]]
    (full,) = bench.statements()[-1].gaps
    lost = {n for _, first, last in full.lost for n in range(first, last + 1)}
    kept = {frame.position.sequence for frame in bench.frames()}
    assert lost.isdisjoint(kept)
    assert max(lost) < min(kept)
    assert full.messages == len(lost)
    assert bench.waiting()[0].position == (1, 0)
    assert sum(len(each.body) for each in bench.waiting()) <= 2**16
    bench.close()


def test_broken_taxels_are_stated_after_each_window(bench: SkinBench) -> None:
    bench.run_to(5.0)
    bench.columns.broken = [("t2", Verdict.CERTAIN, Verdict.POSSIBLE), ("t4", 0, 1)]
    bench.run_to(41.0)
    first, second = bench.statements()
    ((gap,), (again,)) = first.gaps, second.gaps
    assert gap.reason == f"t2 {TEXTS[DEAD]}"
    assert gap.patches == again.patches == (1,)
    assert (gap.samples, again.samples) == (0, 20 * 50)


def apply(bench: SkinBench, **arguments: float | str) -> Any:
    return bench.controls.apply("set", arguments)


def test_rate_is_in_the_grid_of_the_next_frames_and_needs_no_new_layout(bench: SkinBench) -> None:
    bench.run_to(1.0)
    assert apply(bench, rate=100.0) == {"*": {"rate": 100.0, "mode": "samples"}}
    bench.run_to(2.0)
    frames = bench.frames()
    assert {frame.layout for frame in frames} == {LAYOUT.content_hash}
    palms = [frame.grids[-1] for frame in frames if frame.page == 0]
    assert [grid.period for grid in palms] == [20_000_000] * 10 + [10_000_000] * 10
    assert [grid.rows for grid in palms] == [5] * 10 + [10] * 10
    assert bench.statements() == []


def test_stopped_node_sends_no_frames_and_states_the_gap_when_it_resumes(bench: SkinBench) -> None:
    bench.run_to(1.0)
    assert apply(bench, mode="peaks") == {"*": {"rate": 50.0, "mode": "peaks"}}
    bench.run_to(3.0)
    assert len(bench.frames()) == 20
    assert apply(bench, mode="samples")["*"]["mode"] == "samples"
    bench.run_to(4.0)
    assert len(bench.frames()) == 40
    ((gap,),) = [each.gaps for each in bench.statements()]
    assert (gap.reason, gap.samples) == (TEXTS[ASLEEP[states.ORDERED]], 20 * SAMPLES)


def test_stopped_node_stays_stopped_after_a_reset(bench: SkinBench) -> None:
    bench.run_to(1.0)
    state = apply(bench, mode="peaks", rate=25.0)
    restored = []
    bench.node.at_start = lambda: restored.append(bench.controls.restore(state))
    bench.node.machine.reset(ResetCause.WATCHDOG)
    bench.run_to(2.0)
    assert restored == [state]
    assert len(bench.frames()) == 20
    assert bench.controls.apply("reset", {}) == {"*": {"rate": 50.0, "mode": "samples"}}
    bench.run_to(3.0)
    assert {frame.grids[-1].period for frame in bench.frames() if frame.page == 0} == {20_000_000}
    assert len(bench.frames()) > 30


@pytest.mark.parametrize(
    ("name", "arguments"),
    [
        ("set", {"rate": 200.0}),
        ("set", {"gain": 2.0}),
        ("set", {"mode": "adaptive"}),
        ("set", {"rate": 10.0, "taxel": "t1"}),
        ("set", {"threshold": 3.0, "channel": "t1.pressure"}),
        ("calibrate", {}),
    ],
)
def test_other_commands_are_refused_and_change_nothing(
    name: str, arguments: Arguments, bench: SkinBench
) -> None:
    before = bench.controls.restore({})
    with pytest.raises(CommandError):
        bench.controls.apply(name, arguments)
    assert bench.controls.restore({}) == before


def test_state_that_no_longer_fits_is_left_out(bench: SkinBench) -> None:
    state = {"*": {"rate": 1e5, "mode": "adaptive"}, "t1": {"gain": 1.0}}
    assert bench.controls.restore(state) == {"*": {"rate": 50.0, "mode": "samples"}}  # type: ignore[arg-type]
