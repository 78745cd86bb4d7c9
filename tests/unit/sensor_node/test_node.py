from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING

import numpy as np
import pytest
from eskin_sensor_node.firmware.channel import union_coverage
from eskin_sensor_node.firmware.gap_reasons import OVERRUN, TEXTS
from eskin_sensor_node.node.ground_truth import GroundTruth

from eskin.interval import Verdict
from eskin.wire.messages import Block, Gap, Peak, Status, decode_message
from tests.unit.sensor_node.designs import SECOND, Bench, table

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

PROFILES = ("fingertip", "palm", "forearm")


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Bench]:
    made = Bench(tmp_path)
    yield made
    made.close()


def blocks_of(bench: Bench) -> list[Block]:
    messages = (decode_message(body) for body in bench.bodies())
    return [message for message in messages if isinstance(message, Block)]


@pytest.mark.parametrize("profile", PROFILES)
@pytest.mark.parametrize("encoding", ["f64", "f32", "q16"])
def test_every_stored_block_holds_its_truth_in_value_and_time(
    profile: str, encoding: str, tmp_path: Path
) -> None:
    bench = Bench(tmp_path, profile, sampling={"encoding": encoding})
    bench.run_to(3.0)
    blocks = blocks_of(bench)
    truth = GroundTruth.read(bench.settings.truth.path, [block.position for block in blocks])
    assert len(truth) == len(blocks) > 30
    for block in blocks:
        true = truth[block.position]
        assert true.channel == block.channel
        assert true.dt == block.tube.dt
        assert block.tube.time[0] <= true.time <= block.tube.time[1]
        assert np.all(block.tube.values.contains(true.values)), block.channel
    bench.close()


@pytest.mark.parametrize("profile", PROFILES)
def test_same_seed_and_start_give_the_same_bytes(profile: str, tmp_path: Path) -> None:
    said = []
    for name, steps in (("a", (4.0,)), ("b", (0.3, 1.1, 4.0))):
        bench = Bench(tmp_path / name, profile)
        for seconds in steps:
            bench.run_to(seconds)
        said.append(list(bench.bodies()))
        bench.close()
    assert said[0] == said[1]
    assert len(said[0]) > 40


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
    positions = [decode_message(body).position for body in bench.bodies()]
    assert [position.sequence for position in positions] == list(range(len(positions)))


def test_blocks_of_a_channel_join_in_time(bench: Bench) -> None:
    bench.run_to(3.0)
    own = [block for block in blocks_of(bench) if block.channel == "t02.current"]
    assert [block.ticks for block in own] == [number * SECOND // 4 for number in range(12)]
    assert {len(block.tube) for block in own} == {250}
    first = own[0].tube.time[0]
    assert [block.tube.time[0] - first for block in own] == [block.ticks for block in own]


def test_hybrid_samples_in_bursts(tmp_path: Path) -> None:
    bench = Bench(tmp_path, "forearm")
    bench.run_to(2.0)
    own = [block for block in blocks_of(bench) if block.channel == "t02.voltage"]
    assert len(own) == 2 * 16
    assert {block.tube.dt for block in own} == {10_000}
    assert own[16].ticks == SECOND
    # The start of each burst is the start of the physics: u_c = 0.
    assert all(block.tube.values.contains(0.0)[0] for block in own[::16])
    bench.close()


def test_no_peak_reaches_from_one_burst_into_the_next(tmp_path: Path) -> None:
    # It ends on a falling edge, so the next burst's start would complete a peak.
    design = table("hybrid", burst_s=0.0325, current_prominence_A=1e-4)
    bench = Bench(tmp_path, "forearm", taxel=[design])
    bench.run_to(5.0)
    peaks = [m for m in map(decode_message, bench.bodies()) if isinstance(m, Peak)]
    assert len(peaks) >= 5
    for peak in peaks:
        assert peak.time[1] - peak.time[0] <= 32_500_000 + 2 * 2_000_000
    bench.close()


def ticks_of(blocks: list[Block]) -> list[int]:
    return [block.ticks + block.tube.dt * k for block in blocks for k in range(len(block.tube))]


def test_blocks_are_short_while_a_viewer_watches(tmp_path: Path) -> None:
    looked_at, alone = Bench(tmp_path / "looked_at", "palm"), Bench(tmp_path / "alone", "palm")
    for bench in looked_at, alone:
        bench.run_to(2.0)
        if bench is looked_at:
            bench.node.attend(1.0)
        bench.run_to(5.0)
    for channel in {block.channel for block in blocks_of(alone)}:
        told, whole = (
            [block for block in blocks_of(bench) if block.channel == channel]
            for bench in (looked_at, alone)
        )
        # Each sample once, at its instant, with or without viewers.
        assert ticks_of(told) == ticks_of(whole)
        short = [block for block in told if 2.3 * SECOND < block.ticks < 3 * SECOND]
        assert [len(block.tube) for block in short] == [50] * len(short) != []
        assert {len(block.tube) for block in told if block.ticks > 3.3 * SECOND} == {250}
    truth = GroundTruth.read(
        looked_at.settings.truth.path, [b.position for b in blocks_of(looked_at)]
    )
    for block in blocks_of(looked_at):
        assert np.all(block.tube.values.contains(truth[block.position].values))
    looked_at.close()
    alone.close()


@pytest.mark.parametrize("shed", [0, 1])
def test_blocks_stay_long_where_the_supply_is_short(tmp_path: Path, shed: int) -> None:
    bench = Bench(tmp_path, "palm", sampling={"watched_block_ms": 100.0})
    bench.run_to(1.0)
    bench.node.taxels[0].control_unit.shed = shed
    bench.node.taxels[0].control_unit.mode = "samples"
    bench.node.attend(10.0)
    before = bench.node.taxels[0].next.start
    bench.run_to(3.0)
    frame = bench.node.taxels[0].next
    assert frame.start > before
    assert frame.n == (250 if shed else 100)
    bench.close()


@pytest.mark.parametrize("profile", PROFILES)
def test_peaks_are_certain_where_it_is_clean_and_no_flood_where_noise_rules(
    profile: str, tmp_path: Path
) -> None:
    bench = Bench(tmp_path, profile)
    bench.run_to(20.0)
    bench.node.finish()
    found: Counter[tuple[str, Verdict]] = Counter()
    for body in bench.bodies():
        message = decode_message(body)
        if isinstance(message, Peak):
            found[message.channel, message.verdict] += 1
            assert message.time[0] <= message.time[1]
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
    peaks = [m for m in map(decode_message, bench.bodies()) if isinstance(m, Peak)]
    blocks = blocks_of(bench)
    assert peaks
    for peak in peaks:
        assert 0.0 < peak.coverage < blocks[0].tube.coverage < 1.0
    bench.close()


def test_union_coverage_is_bounded_and_rounded_down() -> None:
    assert union_coverage(1.0, 10**9) == 1.0
    assert union_coverage(0.5, 3) == 0.0
    assert 0.9 - 1e-15 < union_coverage(0.99, 10) < 0.9


def test_overrun_is_a_gap_that_counts_the_missing_samples(bench: Bench) -> None:
    bench.run_to(2.0)
    bench.ticks = round(7.1 * SECOND)
    bench.node.advance(bench.ticks)
    bench.run_to(9.0)
    messages = [decode_message(body) for body in bench.bodies()]
    gap = next(message for message in messages if isinstance(message, Gap))
    own = [block for block in blocks_of(bench) if block.channel == "t01.capacitance"]
    ticks = [block.ticks for block in own]
    assert ticks == [n * SECOND // 4 for n in range(36) if n < 8 or n >= 29]
    assert gap.reason == TEXTS[OVERRUN]
    assert gap.samples == 6 * (29 - 8) * 250
    assert gap.messages == 0
    assert gap.lost == ()
    assert gap.time[0] == bench.clock.known.enclosure(2 * SECOND)[0]
    assert gap.time[1] == bench.clock.known.enclosure(29 * SECOND // 4)[1]
    # No peak reaches over the hole.
    inside = (
        bench.clock.known.enclosure(2 * SECOND)[1],
        bench.clock.known.enclosure(7 * SECOND)[0],
    )
    for message in messages:
        if isinstance(message, Peak):
            assert message.time[1] <= inside[0] or message.time[0] >= inside[1]


def test_being_a_little_late_loses_nothing(bench: Bench) -> None:
    bench.run_to(1.0)
    bench.ticks = round(1.9 * SECOND)
    bench.node.advance(bench.ticks)
    assert not any(isinstance(decode_message(body), Gap) for body in bench.bodies())
    assert len(blocks_of(bench)) == 6 * 7


def test_full_disk_is_logged_once_and_ends_in_a_gap(
    bench: Bench, caplog: pytest.LogCaptureFixture
) -> None:
    bench.run_to(1.0)
    before = len(blocks_of(bench))
    pages = bench.flash.file.db.execute("PRAGMA page_count").fetchone()[0]
    bench.flash.file.db.execute(f"PRAGMA max_page_count = {pages}")
    bench.run_to(4.0)
    stored = len(blocks_of(bench))
    bench.flash.file.db.execute("PRAGMA max_page_count = 1000000")
    bench.run_to(5.0)
    messages = [decode_message(body) for body in bench.bodies()]
    gaps = [message for message in messages if isinstance(message, Gap)]
    assert len(gaps) == 1
    lost_blocks = 5 * 4 * 6 - len(blocks_of(bench))
    assert lost_blocks > 0
    assert stored - before < 3 * 4 * 6
    assert gaps[0].samples == lost_blocks * 250
    assert [r.levelname for r in caplog.records if "flash commit failed" in r.message] == ["ERROR"]
    assert any("flash commit succeeded again" in record.message for record in caplog.records)


def test_block_without_truth_is_not_stored(bench: Bench) -> None:
    bench.run_to(1.0)
    pages = bench.truth._db.execute("PRAGMA page_count").fetchone()[0]
    bench.truth._db.execute(f"PRAGMA max_page_count = {pages}")
    bench.run_to(6.0)
    blocks = blocks_of(bench)
    truth = GroundTruth.read(bench.settings.truth.path, [block.position for block in blocks])
    assert len(truth) == len(blocks) > 0
    bench.truth._db.execute("PRAGMA max_page_count = 1000000")
    bench.run_to(7.0)
    assert any(isinstance(decode_message(body), Gap) for body in bench.bodies())


def test_status_describes_the_node(bench: Bench) -> None:
    bench.run_to(1.5)
    usage = bench.outbox.usage()
    position = bench.node.record_status()
    stored = bench.flash.read((position.boot, position.sequence))
    assert stored is not None
    status = decode_message(stored.body)
    assert isinstance(status, Status)
    assert status.profile == "fingertip"
    assert status.uptime == bench.ticks
    assert (status.messages, status.used, status.capacity, status.gaps) == usage
    assert [info.channel for info in status.channels][:2] == ["t01.capacitance", "t01.current"]
    assert {info.unit for info in status.channels} == {"F", "A"}
    true = bench.clock.true_time(bench.ticks)
    assert status.time[0] <= true <= status.time[1]
