from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from eskin_sensor_node.firmware.schedule import Frame
from eskin_sensor_node.machine.ledger import Ledger
from eskin_sensor_node.machine.machine import START_UP
from eskin_sensor_node.machine.prices import PRICES

from tests.unit.sensor_node.designs import SECOND, Bench

if TYPE_CHECKING:
    from pathlib import Path

CLOCK_HZ = 160_000_000


def test_a_span_holds_no_more_than_its_time_and_the_rest_goes_into_the_next() -> None:
    ledger = Ledger(CLOCK_HZ)
    ledger.charge_hang(3 * SECOND)
    ledger.charge_off(SECOND)
    first, second = ledger.take(2 * SECOND), ledger.take(5 * SECOND)
    assert (first.span, first.asleep, first.cycles) == (2 * SECOND, 0, 3 * CLOCK_HZ)
    assert (second.span, second.asleep, second.cycles) == (3 * SECOND, SECOND, 0)


def test_fast_burst_leaves_no_time_to_sleep_between_samples() -> None:
    ledger = Ledger(CLOCK_HZ)
    frame = Frame(0, 0, 0, 0, 250, 10_000, closes=False)
    ledger.charge_frame(frame, cycles=PRICES["hybrid"].times(250), inputs=2)
    assert ledger.take(frame.end).asleep == 0


@pytest.mark.parametrize("profile", ["fingertip", "palm", "forearm", "hand"])
def test_node_sleeps_deeply_between_samples_and_counts_what_it_did(
    profile: str, tmp_path: Path
) -> None:
    bench = Bench(tmp_path, profile)
    bench.run_to(4.0)
    work = bench.node.machine.ledger.take(4 * SECOND)
    samples = {taxel.name: 0 for taxel in bench.node.taxels}
    for each in bench.node.taxels:
        samples[each.name] = each.control_unit.schedule.before(each.next.start) * each.inputs
    assert work.conversions == sum(samples.values())
    assert work.span == 4 * SECOND
    assert 0 < work.fewest < work.cycles < 4 * bench.settings.machine.clock_hz
    assert work.written > 0
    assert 0.05 < work.asleep / work.span < 1.0
    bench.close()


def test_time_without_power_is_not_sleep(tmp_path: Path) -> None:
    bench = Bench(tmp_path)
    ledger, machine = bench.node.machine.ledger, bench.node.machine
    bench.node.shed("ordered")
    machine.events.at(SECOND, lambda: machine.reset(machine.cause))
    machine.events.at(SECOND + START_UP + 1, lambda: bench.node.shed("ordered"))
    bench.run_to(2.0)
    assert ledger.take(2 * SECOND).asleep == 2 * SECOND - START_UP
    bench.close()
