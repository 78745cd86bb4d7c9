from __future__ import annotations

import pytest
from eskin_sensor_node.machine.machine import NEVER, EventQueue
from hypothesis import given
from hypothesis import strategies as st


def run_to(events: EventQueue, time: int) -> None:
    while events.next_due <= time:
        events.step()
    events.pass_to(time)


@given(st.lists(st.integers(0, 20), max_size=40), st.lists(st.integers(0, 25), max_size=6))
def test_events_come_by_time_then_in_order_of_scheduling_however_time_is_cut(
    times: list[int], stops: list[int]
) -> None:
    events, seen = EventQueue(), []
    for number, time in enumerate(times):
        events.at(time, lambda number=number: seen.append((events.now, number)))  # type: ignore[misc]  # mypy infers no lambda defaults
    for stop in [*sorted(stops), 25]:
        run_to(events, stop)
    assert seen == sorted((time, number) for number, time in enumerate(times))
    assert events.next_due == NEVER


def test_periodic_timer_fires_until_it_is_stopped() -> None:
    events, seen = EventQueue(), []
    timer = events.every(3, lambda: seen.append(events.now))
    run_to(events, 10)
    timer.stop()
    run_to(events, 20)
    assert seen == [3, 6, 9]
    with pytest.raises(ValueError, match="period of 0 ns"):
        events.every(0, lambda: None)


def test_timer_armed_anew_fires_only_at_its_new_time() -> None:
    events, seen = EventQueue(), []
    timer = events.at(5, lambda: seen.append(events.now))
    events.arm(timer, 8)
    run_to(events, 30)
    assert seen == [8]
    events.at(2, lambda: seen.append(events.now))
    run_to(events, 40)
    assert seen == [8, 30]
