from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING

import pytest
from eskin_sensor_node.firmware.channel import union_coverage
from eskin_sensor_node.firmware.gap_reasons import OVERRUN, TEXTS

from eskin.interval import Verdict
from eskin.wire.messages import Status
from tests.unit.sensor_node.designs import SECOND, Bench, table
from tests.unit.sensor_node.messages import (
    assert_truth_is_inside,
    decode,
    frames_of,
    gaps_of,
    peaks_of,
    samples_of,
    true_frames,
)

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

PROFILES = ("fingertip", "palm", "forearm")
STRETCH = SECOND // 20
"""Of the packaged profiles."""


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Bench]:
    made = Bench(tmp_path)
    yield made
    made.close()


@pytest.mark.parametrize("profile", PROFILES)
def test_every_stored_frame_holds_its_truth_in_value_and_time(profile: str, tmp_path: Path) -> None:
    bench = Bench(tmp_path, profile)
    bench.run_to(1.0)
    frames = frames_of(bench.bodies())
    truth = true_frames(bench, frames)
    assert len(truth) == len(frames) > 10
    for frame in frames:
        true = truth[frame.position]
        assert (true.layout, true.ticks) == (frame.layout, frame.ticks)
        assert frame.time[0] <= true.time <= frame.time[1]
    assert_truth_is_inside(samples_of(bench))
    bench.close()


@pytest.mark.parametrize("profile", PROFILES)
def test_same_seed_and_start_give_the_same_bytes(profile: str, tmp_path: Path) -> None:
    said = []
    for name, steps in (("a", (2.0,)), ("b", (0.3, 1.1, 2.0))):
        bench = Bench(tmp_path / name, profile)
        for seconds in steps:
            bench.run_to(seconds)
        said.append(list(bench.bodies()))
        bench.close()
    assert said[0] == said[1]
    assert len(said[0]) > 20


def test_other_seed_gives_other_bytes(tmp_path: Path) -> None:
    first, second = Bench(tmp_path / "a"), Bench(tmp_path / "b")
    second.node = type(second.node)(
        second.settings, clock=second.clock, outbox=second.outbox, truth=second.truth, seed=8
    )
    for bench in (first, second):
        bench.run_to(1.0)
    assert set(first.bodies()).isdisjoint(second.bodies())
    first.close()
    second.close()


def test_sequences_follow_each_other_without_a_hole(bench: Bench) -> None:
    bench.run_to(2.0)
    bench.node.record_status()
    bench.run_to(3.0)
    positions = [decode(body).position for body in bench.bodies()]
    assert [position.sequence for position in positions] == list(range(len(positions)))


def test_samples_of_a_channel_join_in_time(bench: Bench) -> None:
    bench.run_to(1.0)
    own = samples_of(bench, "t02.current")
    assert [each.ticks for each in own] == [number * STRETCH for number in range(20)]
    assert {len(each.tube) for each in own} == {50}
    first = own[0].tube.time[0]
    assert [each.tube.time[0] - first for each in own] == [each.ticks for each in own]


def test_hybrid_samples_in_bursts(tmp_path: Path) -> None:
    bench = Bench(tmp_path, "forearm")
    bench.run_to(2.0)
    own = samples_of(bench, "t02.voltage")
    assert sum(len(each.tube) for each in own) == 2 * 4000
    assert {each.tube.dt for each in own} == {10_000}
    begins = [each for each in own if each.ticks % SECOND == 0]
    assert [each.ticks for each in begins] == [0, SECOND]
    # The start of each burst is the start of the physics: u_c = 0.
    assert all(each.tube.values.contains(0.0)[0] for each in begins)
    bench.close()


def test_bursts_of_one_stretch_have_frames_of_their_own(tmp_path: Path) -> None:
    design = table("hybrid", burst_s=0.002, burst_period_s=0.3)
    bench = Bench(tmp_path, "forearm", taxel=[design], sampling={"stretch_ms": 1000.0})
    bench.run_to(2.0)
    frames = frames_of(bench.bodies())
    assert [frame.ticks for frame in frames] == [k * 3 * SECOND // 10 for k in range(7)]
    assert {grid.rows for frame in frames for grid in frame.grids} == {200}
    assert_truth_is_inside(samples_of(bench))
    bench.close()


def test_no_peak_reaches_from_one_burst_into_the_next(tmp_path: Path) -> None:
    # It ends on a falling edge, so the next burst's start would complete a peak.
    design = table("hybrid", burst_s=0.0325, current_prominence_A=1e-4)
    bench = Bench(tmp_path, "forearm", taxel=[design])
    bench.run_to(5.0)
    peaks = peaks_of(bench)
    assert len(peaks) >= 5
    for peak in peaks:
        assert peak.time[1] - peak.time[0] <= 32_500_000 + 2 * 2_000_000
    bench.close()


@pytest.mark.parametrize("profile", PROFILES)
def test_peaks_are_certain_where_it_is_clean_and_no_flood_where_noise_rules(
    profile: str, tmp_path: Path
) -> None:
    bench = Bench(tmp_path, profile)
    bench.run_to(20.0)
    bench.node.finish()
    found: Counter[tuple[str, Verdict]] = Counter()
    for peak in peaks_of(bench):
        found[peak.channel, peak.verdict] += 1
        assert peak.time[0] <= peak.time[1]
    swings = {"fingertip": 40, "palm": 16, "forearm": 20}[profile]
    channels = {channel for channel, _ in found}
    for channel in channels:
        certain = found[channel, Verdict.CERTAIN]
        assert certain >= swings - 1, channel
        assert found[channel, Verdict.POSSIBLE] <= 60, channel
    assert len(channels) == {"fingertip": 6, "palm": 3, "forearm": 5}[profile]
    if profile == "palm":
        assert found["t01.energy", Verdict.POSSIBLE] > 0
    bench.close()


def test_peak_of_gaussian_channel_carries_the_union_bound(tmp_path: Path) -> None:
    bench = Bench(tmp_path, "palm")
    bench.run_to(5.0)
    peaks, samples = peaks_of(bench), samples_of(bench)
    assert peaks
    for peak in peaks:
        assert 0.0 < peak.coverage < samples[0].tube.coverage < 1.0
    bench.close()


def test_union_coverage_is_bounded_and_rounded_down() -> None:
    assert union_coverage(1.0, 10**9) == 1.0
    assert union_coverage(0.5, 3) == 0.0
    assert 0.9 - 1e-15 < union_coverage(0.99, 10) < 0.9


def test_overrun_is_a_gap_that_counts_the_missing_samples(bench: Bench) -> None:
    bench.run_to(1.0)
    bench.ticks = round(4.03 * SECOND)
    bench.node.advance(bench.ticks)
    bench.run_to(5.0)
    (gap,) = gaps_of(bench)
    own = samples_of(bench, "t01.capacitance")
    missing = range(20, 81)
    assert [each.ticks for each in own] == [n * STRETCH for n in range(100) if n not in missing]
    assert gap.reason == TEXTS[OVERRUN]
    assert gap.samples == 6 * len(missing) * 50
    assert gap.messages == 0
    assert gap.lost == ()
    known = bench.clock.known
    assert gap.time[0] == known.enclosure(SECOND)[0]
    assert gap.time[1] == known.enclosure(missing.stop * STRETCH)[1]
    # No peak reaches over the hole.
    inside = known.enclosure(SECOND)[1], known.enclosure(4 * SECOND)[0]
    for peak in peaks_of(bench):
        assert peak.time[1] <= inside[0] or peak.time[0] >= inside[1]


def test_being_a_little_late_loses_nothing(bench: Bench) -> None:
    bench.run_to(1.0)
    bench.ticks = round(1.9 * SECOND)
    bench.node.advance(bench.ticks)
    assert gaps_of(bench) == []
    assert len(frames_of(bench.bodies())) == 38


def test_full_disk_is_logged_once_and_ends_in_a_gap(
    bench: Bench, caplog: pytest.LogCaptureFixture
) -> None:
    bench.run_to(1.0)
    pages = bench.flash.file.db.execute("PRAGMA page_count").fetchone()[0]
    bench.flash.file.db.execute(f"PRAGMA max_page_count = {pages}")
    bench.run_to(3.0)
    stored = len(frames_of(bench.bodies()))
    bench.flash.file.db.execute("PRAGMA max_page_count = 1000000")
    bench.run_to(4.0)
    (gap,) = gaps_of(bench)
    lost = 80 - len(frames_of(bench.bodies()))
    assert lost > 0
    assert stored < 60
    assert gap.samples == lost * 6 * 50
    assert [r.levelname for r in caplog.records if "flash commit failed" in r.message] == ["ERROR"]
    assert any("flash commit succeeded again" in record.message for record in caplog.records)


def test_frame_without_truth_is_not_stored(bench: Bench) -> None:
    bench.run_to(1.0)
    pages = bench.truth._db.execute("PRAGMA page_count").fetchone()[0]
    bench.truth._db.execute(f"PRAGMA max_page_count = {pages}")
    bench.run_to(4.0)
    frames = frames_of(bench.bodies())
    assert len(true_frames(bench, frames)) == len(frames) > 0
    bench.truth._db.execute("PRAGMA max_page_count = 1000000")
    bench.run_to(5.0)
    assert gaps_of(bench)


def test_status_describes_the_node(bench: Bench) -> None:
    bench.run_to(1.5)
    usage = bench.outbox.usage()
    position = bench.node.record_status()
    stored = bench.flash.read((position.boot, position.sequence))
    assert stored is not None
    status = Status.decode(stored.body)
    assert status.profile == "fingertip"
    assert status.uptime == bench.ticks
    assert (status.messages, status.used, status.capacity, status.gaps) == usage
    true = bench.clock.true_time(bench.ticks)
    assert status.time[0] <= true <= status.time[1]
