"""Members that are set alike sample together again, and say the same bytes as alone."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from eskin_sensor_node.firmware.message_writer import FRAME, STATEMENTS
from hypothesis import example, given
from hypothesis import settings as effort
from hypothesis import strategies as st

from tests.unit.sensor_node.fleet.shards import NAMES, Bench, Single

if TYPE_CHECKING:
    from collections.abc import Callable


ROWS = range(len(NAMES))
COMMANDS: list[tuple[str, dict[str, Any]]] = [
    ("set", {"threshold": 2e-12, "channel": "t01.capacitance"}),
    ("set", {"gain": 1.5}),
    ("set", {"smoothing": 0.6, "taxel": "t09"}),
    ("set", {"rate": 20.0}),
    ("set", {"mode": "peaks", "taxel": "t09"}),
    ("set", {"mode": "adaptive"}),
    ("calibrate", {}),
    ("reset", {}),
]
THRESHOLD, GAIN, SMOOTHING, RATE, PEAKS, ADAPTIVE, CALIBRATE, RESET = range(len(COMMANDS))


def play(bench: Bench, singles: list[Single], orders: list[tuple[int, set[int], int]]) -> None:
    """Give orders to members and to single nodes: fifth of a second, members, command."""
    for instant, rows, number in sorted(orders, key=lambda order: order[0]):
        bench.run_to(instant / 5)
        for row in rows:
            singles[row].run_to(instant / 5)
            name, arguments = COMMANDS[number]
            state = singles[row].controls.apply(name, arguments)
            assert bench.controls(row).apply(name, arguments) == state


@pytest.mark.nightly
@effort(max_examples=2, deadline=None)
@given(
    st.lists(
        st.tuples(
            st.integers(1, 40),
            st.sets(st.sampled_from(ROWS), min_size=1),
            st.integers(0, RESET),
        ),
        max_size=6,
    )
)
@example([(3, {0, 1, 2}, GAIN), (4, {1}, THRESHOLD), (30, {0, 2}, THRESHOLD)])
@example([(3, {0}, RATE), (5, {0}, RESET), (9, {1}, SMOOTHING), (26, {1}, RESET)])
@example([(2, {0, 1}, CALIBRATE), (7, {0, 1}, ADAPTIVE), (8, {2}, PEAKS), (26, {1, 2}, RATE)])
def test_members_set_in_any_order_say_what_single_nodes_say(
    orders: list[tuple[int, set[int], int]],
) -> None:
    with tempfile.TemporaryDirectory() as folder:
        bench = Bench(Path(folder) / "fleet")
        singles = [Single(bench, row, Path(folder) / str(row)) for row in ROWS]
        play(bench, singles, orders)
        bench.run_to(13.0)
        assert not bench.shard.singles
        together = {bench.cohort(row).key: bench.cohort(row) for row in ROWS}
        assert len(bench.shard.cohorts) == len(together)
        bench.finish()
        for row, single in enumerate(singles):
            single.run_to(13.0)
            single.node.finish()
            assert bench.said(row) == single.said()
            assert {FRAME, STATEMENTS} <= {kind for kind, _ in bench.said(row)}
            single.close()
        bench.close()


def test_members_that_came_to_the_same_settings_in_other_ways_share_a_cohort(
    make: Callable[..., Bench],
) -> None:
    bench = make()
    whole = [bench.cohort(row) for row in ROWS]
    bench.run_to(0.9)
    bench.controls(0).apply("set", {"gain": 2.0, "rate": 20.0})
    bench.run_to(1.4)
    bench.controls(1).apply("set", {"rate": 4.0})
    bench.controls(2).apply("set", {"gain": 2.0})
    bench.run_to(4.0)
    assert len({id(bench.cohort(row)) for row in ROWS}) == len(ROWS)
    bench.controls(0).apply("reset", {})
    bench.controls(0).apply("set", {"gain": 2.0})
    bench.run_to(4.7)
    bench.controls(1).apply("set", {"rate": 50.0, "gain": 2.0, "taxel": "t09"})
    bench.controls(1).apply("set", {"rate": 100.0, "gain": 2.0, "taxel": "t01"})
    bench.run_to(8.0)
    (cohort,) = bench.shard.cohorts
    assert sorted(cohort.members) == list(ROWS)
    assert cohort not in whole


def test_command_to_all_leaves_no_single_node_after_a_restart(
    make: Callable[..., Bench],
) -> None:
    bench = make()
    for row in ROWS:
        bench.run_to(0.4 * (row + 1))
        state = bench.controls(row).apply("set", {"rate": 30.0, "smoothing": 0.25})
    again = bench.shard = bench.build()
    for row in ROWS:
        assert bench.controls(row).restore(state) == state
    assert list(again.singles) == list(ROWS)
    again.regroup(at_once=True)
    assert not again.singles
    (cohort,) = again.cohorts
    assert cohort.members == list(ROWS)
    bench.run_to(3.0)
    assert {FRAME, STATEMENTS} <= {kind for kind, _ in bench.said(1)}


def test_member_that_adapts_by_itself_stays_alone_until_it_does_not(
    make: Callable[..., Bench],
) -> None:
    bench = make()
    bench.controls(1).apply("set", {"adaptive": "on"})
    bench.run_to(5.0)
    assert list(bench.shard.singles) == [1]
    bench.controls(1).apply("set", {"adaptive": "off"})
    bench.run_to(9.0)
    assert not bench.shard.singles
    assert bench.cohort(1) is bench.cohort(0)
