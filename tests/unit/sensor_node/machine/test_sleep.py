"""Deep sleep: none of the samples that are due is lost; sampling given up is stated as a gap."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from eskin_sensor_node.firmware import states
from eskin_sensor_node.firmware.states import TRANSITIONS, StateMachine

from tests.unit.sensor_node.designs import SECOND, Bench
from tests.unit.sensor_node.messages import gaps_of, samples_of

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Bench]:
    made = Bench(tmp_path)
    yield made
    made.close()


def test_every_state_is_reached_and_only_a_failure_is_final() -> None:
    reached = set(TRANSITIONS.values()) | {states.BOOT}
    assert reached == {states.BOOT, states.RUN, states.SLEEP, states.SHED, states.HALT}
    assert reached - {state for state, _ in TRANSITIONS} == {states.HALT}


def test_illegal_transition_is_refused_and_changes_nothing() -> None:
    machine = StateMachine()
    with pytest.raises(ValueError, match="no way out of boot for due"):
        machine.take(states.DUE, 5)
    assert (machine.state, machine.spent(states.BOOT, 7)) == (states.BOOT, 7)


def test_time_is_counted_state_by_state() -> None:
    machine = StateMachine()
    for ticks, cause in enumerate((states.STARTED, states.DUE, states.IDLE, states.SCARCE)):
        machine.take(cause, ticks * ticks)
    assert machine.cause == states.SCARCE
    assert [machine.spent(state, 20) for state in (states.RUN, states.SLEEP, states.SHED)] == [
        3,
        1 + 5,
        11,
    ]


def test_node_sleeps_between_frames_and_loses_no_sample(bench: Bench) -> None:
    bench.run_to(5.0)
    assert sum(len(each.tube) for each in samples_of(bench)) == 6 * 5000
    assert bench.node.states.state == states.SLEEP
    assert bench.node.states.spent(states.SLEEP, bench.ticks) == bench.ticks


@pytest.mark.parametrize("cause", [states.SCARCE, states.ORDERED])
def test_sampling_given_up_is_a_gap_that_counts_what_is_missing(bench: Bench, cause: str) -> None:
    bench.run_to(1.13)
    bench.node.shed(cause)
    with bench.node.between_frames():
        pass  # a command, which does not wake it
    bench.run_to(3.13)
    before = len(list(bench.bodies()))
    bench.run_to(20.0)
    assert len(list(bench.bodies())) == before
    bench.node.resume()
    bench.run_to(21.0)
    (gap,) = gaps_of(bench)
    assert gap.reason == f"deep sleep: {cause}"
    taken = sum(len(each.tube) for each in samples_of(bench))
    assert taken + gap.samples == 6 * 21 * 1000
    assert gap.time[0] == bench.clock.known.enclosure(11 * SECOND // 10)[0]
    assert bench.node.states.spent(states.SHED, bench.ticks) == round(18.87 * SECOND)
    assert bench.node.machine.resets == 0
