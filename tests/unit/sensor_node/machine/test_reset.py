"""Resets: what flash held stays, what RAM held does not, and a gap states the time between."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from eskin_sensor_node.machine.machine import START_UP

from eskin.wire.frames import Frame, Statements
from eskin.wire.messages import ResetCause, Status
from tests.unit.sensor_node.designs import SECOND, Bench
from tests.unit.sensor_node.machine.hanging import hang
from tests.unit.sensor_node.messages import (
    assert_truth_is_inside,
    decode,
    frames_of,
    gaps_of,
    samples_of,
    true_frames,
)

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from eskin.wire.messages import Message


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Bench]:
    made = Bench(tmp_path, drift=50_000)
    yield made
    made.close()


def messages(bench: Bench) -> list[Message | Frame | Statements]:
    return [decode(body) for body in bench.bodies()]


def reset_at(bench: Bench, seconds: float, cause: ResetCause) -> None:
    machine = bench.node.machine
    machine.events.at(round(seconds * SECOND), lambda: machine.reset(cause))


def require_truth(bench: Bench) -> None:
    found = samples_of(bench)
    assert_truth_is_inside(found)
    assert all(each.tube.time[0] <= each.time <= each.tube.time[1] for each in found)


def count(bench: Bench, boot: int) -> int:
    """Samples of a boot that are in flash."""
    return sum(len(each.tube) for each in samples_of(bench) if each.position.boot == boot)


@pytest.mark.parametrize("cause", [ResetCause.BROWN_OUT, ResetCause.SOFTWARE])
def test_reset_keeps_flash_counts_the_boot_and_explains_the_missing_time(
    bench: Bench, cause: ResetCause
) -> None:
    bench.run_to(1.13)
    before = list(bench.bodies())
    reset_at(bench, 1.13, cause)
    bench.run_to(3.0)
    bench.node.record_status()
    said = messages(bench)
    assert list(bench.bodies())[: len(before)] == before
    assert [m.position.boot for m in said] == [1] * len(before) + [2] * (len(said) - len(before))
    second = [m for m in said if m.position.boot == 2]
    assert [m.position.sequence for m in second] == list(range(len(second)))
    stated, status = second[0], second[-1]
    assert isinstance(stated, Statements)
    (gap,) = stated.gaps
    assert gap.reason == f"{cause.label} reset"
    # From the first sample that was not stored to the first of the new boot; 1 kHz, 6 channels.
    assert gap.samples == 6 * round((0.03 * SECOND + START_UP) / 1e6)
    true = bench.clock.true_time(0)
    assert gap.time[0] <= true - START_UP - 3 * SECOND // 100 + 10_000
    assert gap.time[1] >= true
    assert isinstance(status, Status)
    assert status.cause is cause
    assert status.uptime == 3 * SECOND - (round(1.13 * SECOND) + START_UP)
    require_truth(bench)


def test_world_goes_on_while_the_machine_starts_again(tmp_path: Path) -> None:
    lives = []
    for name in ("reset", "not reset"):
        bench = Bench(tmp_path / name)
        if name == "reset":
            reset_at(bench, 1.1, ResetCause.BROWN_OUT)
        bench.run_to(3.0)
        own = samples_of(bench, "t01.capacitance")
        values = ((t.time + k * t.tube.dt, v) for t in own for k, v in enumerate(t.truth))
        lives.append(dict(values))
        bench.close()
    both = lives[0].keys() & lives[1].keys()
    assert len(both) > 2500
    assert [lives[0][time] for time in both] == pytest.approx([lives[1][time] for time in both])


def test_first_start_is_reported_as_power_on(bench: Bench) -> None:
    bench.node.record_status()
    (status,) = messages(bench)
    assert isinstance(status, Status)
    assert status.cause is ResetCause.POWER_ON


def test_watchdog_resets_firmware_that_hangs(
    bench: Bench, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    hang(monkeypatch, "t02", 3)
    bench.run_to(12.0)
    last = max(each.tube.time[1] for each in samples_of(bench) if each.position.boot == 1)
    (gap,) = gaps_of(bench)
    assert gap.reason == "watchdog reset"
    # It hangs at 0.2 s, its last sign of life: t01's frame of that instant.
    assert bench.node.machine.booted == 8 * SECOND + SECOND // 5 + START_UP
    assert bench.node.machine.cause is ResetCause.WATCHDOG
    assert last <= gap.time[0] + SECOND // 4
    assert count(bench, 1) + gap.samples == 6 * (8200 + START_UP // 1_000_000)
    assert "t02: IndexError: index out of range" in caplog.text
    require_truth(bench)


def test_firmware_that_wakes_seldom_is_not_reset(tmp_path: Path) -> None:
    bench = Bench(tmp_path, machine={"watchdog_s": 0.05})
    bench.run_to(2.0)
    assert bench.node.machine.resets == 0
    bench.close()


def test_nothing_runs_between_power_off_and_power_on(bench: Bench) -> None:
    machine = bench.node.machine
    machine.events.at(SECOND, lambda: machine.power_off(ResetCause.BROWN_OUT))
    bench.run_to(30.0)
    assert {m.position.boot for m in messages(bench)} == {1}
    machine.power_on()
    bench.run_to(31.0)
    assert {m.position.boot for m in messages(bench)} == {1, 2}
    (gap,) = gaps_of(bench)
    assert gap.samples + count(bench, 1) == 6 * 30 * 1000
    require_truth(bench)


@pytest.mark.parametrize(
    "profile",
    [
        pytest.param("fingertip", marks=pytest.mark.nightly),
        "hand",
        pytest.param("forearm", marks=pytest.mark.nightly),
    ],
)
def test_same_bytes_and_truth_in_steps_of_real_time_or_at_once_over_resets(
    profile: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    reported = []
    for name in ("real time", "at once"):
        with monkeypatch.context() as patch:
            hang(patch, "t02", 4)
            bench = Bench(tmp_path / name, profile, drift=50_000, machine={"watchdog_s": 0.7})
            reset_at(bench, 0.777, ResetCause.BROWN_OUT)
            if name == "at once":
                bench.node.run_until(5 * SECOND)
            else:
                bench.run_to(5.0)
        bodies = list(bench.bodies())
        truth = true_frames(bench, frames_of(bodies))
        values = [(t.time, t.end, t.values.tobytes()) for t in truth.values()]
        reported.append((bodies, values))
        bench.close()
    assert reported[0] == reported[1]
    assert bench.node.machine.resets >= 1
    assert len(reported[0][0]) > 20
