"""A member that is set says byte for byte what a single node says that is set likewise."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import pytest
from eskin_sensor_node.firmware.message_writer import FRAME, STATEMENTS
from eskin_sensor_node.fleet.member import MemberControls
from eskin_sensor_node.fleet.single_node import reason_to_sample_alone
from eskin_sensor_node.machine.node_layout import plan_layout
from eskin_sensor_node.node.commands import NodeControls
from eskin_sensor_node.node.ground_truth import GroundTruth

from eskin.errors import CommandError
from eskin.wire.frames import Statements
from eskin.wire.messages import Status
from tests.unit.sensor_node.designs import SECOND, table
from tests.unit.sensor_node.fleet.shards import NAMES, Bench, Single
from tests.unit.sensor_node.messages import (
    assert_truth_is_inside,
    decode,
    frames_of,
    split,
    statements_of,
)

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from eskin.wire.messages.command import Arguments

MONITOR: Arguments = {
    "formula": "once[0,50ms] t01.capacitance > 50 pF",
    "on": "possible",
    "output": "stop",
}
COMMANDS: list[list[tuple[float, str, dict[str, Any]]]] = [
    [(1.3, "set", {"threshold": 2e-12, "channel": "t01.capacitance"})],
    [(1.3, "set", {"gain": 1.5}), (2.9, "reset", {})],
    [(2.3, "set", {"smoothing": 0.6, "taxel": "t01"})],
    [(0.7, "set", {"rate": 25.0, "taxel": "t01"}), (2.2, "set", {"mode": "peaks"})],
    [(1.3, "calibrate", {}), (1.5, "set", {"mode": "adaptive"})],
    [(2.3, "set", {"adaptive": "on"})],
    [(1.3, "monitor", {"monitor": "squeeze"} | MONITOR), (2.9, "set", {"gain": 1.5})],
]


@pytest.mark.parametrize("orders", COMMANDS, ids=lambda orders: "-".join(o[1] for o in orders))
def test_member_after_a_command_equals_a_single_node(
    make: Callable[..., Bench], tmp_path: Path, orders: list[tuple[float, str, dict[str, Any]]]
) -> None:
    bench = make()
    singles = [Single(bench, row, tmp_path / str(row)) for row in (0, 1)]
    member, alone = MemberControls(bench.shard, 1), NodeControls(singles[1].node)
    assert member.restore({}) == alone.restore({})
    for instant, name, arguments in orders:
        bench.run_to(instant)
        for single in singles:
            single.run_to(instant)
        assert member.apply(name, arguments) == alone.apply(name, arguments)
    bench.run_to(4.1)
    bench.finish()
    for row, single in enumerate(singles):
        single.run_to(4.1)
        single.node.finish()
        assert bench.said(row) == single.said()
        assert {FRAME, STATEMENTS} <= {kind for kind, _ in bench.said(row)}
        single.close()
    assert bench.cohort(0).members == [0, 2]


def test_columns_with_a_part_of_the_rate_equal_a_single_node_s(
    make: Callable[..., Bench], tmp_path: Path
) -> None:
    taxels = [table("capacitive", id=name, sampling_Hz=100.0) for name in ("t01", "t02", "t03")]
    bench = make(taxel=taxels)
    single = Single(bench, 1, tmp_path / "single")
    member, alone = MemberControls(bench.shard, 1), NodeControls(single.node)
    orders: list[tuple[float, str, dict[str, Any]]] = [
        (1.3, "set", {"rate": 25.0, "taxel": "t02"}),
        (2.1, "set", {"rate": 12.5, "taxel": "t01"}),
        (9.3, "reset", {}),
    ]
    for instant, name, arguments in orders:
        bench.run_to(instant)
        single.run_to(instant)
        assert name == "set" or not bench.shard.singles
        assert member.apply(name, arguments) == alone.apply(name, arguments)
    bench.run_to(11.1)
    single.run_to(11.1)
    frames = frames_of(body for _, body in bench.said(1))
    assert {each.strides for frame in frames for each in frame.patches} >= {
        b"", bytes([0, 2, 0]), bytes([3, 2, 0])
    }  # fmt: skip
    assert bench.said(1) == single.said()
    single.close()


def test_member_encloses_the_truth_before_and_after_a_command(
    make: Callable[..., Bench],
) -> None:
    bench = make()
    controls = MemberControls(bench.shard, 2)
    bench.run_to(1.3)
    controls.apply("set", {"gain": 0.5, "rate": 20.0})
    bench.run_to(8.0)
    frames = frames_of(body for _, body in bench.said(2))
    known = GroundTruth.read_frames(
        bench.settings.truth.path.with_name("known.sqlite"),
        [frame.position for frame in frames],
        node=NAMES[2],
    )
    patches = plan_layout(bench.settings).patches
    found = [each for f in frames for each in split(f, patches, known[f.position])]
    assert_truth_is_inside(found)
    assert all(each.tube.time[0] <= each.time <= each.tube.time[1] for each in found)
    assert len({each.tube.dt for each in found}) == 3


def test_refused_command_leaves_a_member_in_its_cohort(make: Callable[..., Bench]) -> None:
    bench = make()
    controls = MemberControls(bench.shard, 0)
    with pytest.raises(CommandError, match="at most 100"):
        controls.apply("set", {"rate": 101.0})
    assert not bench.shard.singles


def test_state_is_restored_and_the_design_needs_no_single_node(
    make: Callable[..., Bench],
) -> None:
    bench = make()
    state = MemberControls(bench.shard, 0).apply("set", {"gain": 2.0})
    again = bench.shard = bench.build()
    assert MemberControls(again, 0).restore(state) == state
    assert MemberControls(again, 1).restore(again.designed) == again.designed
    assert list(again.singles) == [0]
    bench.run_to(2.0)


def test_member_runs_a_monitor_alone_and_joins_its_cohort_without_it(
    make: Callable[..., Bench],
) -> None:
    bench = make()
    controls = MemberControls(bench.shard, 1)
    bench.run_to(1.3)
    state = controls.apply("monitor", {"monitor": "squeeze", **MONITOR})
    assert state["monitor:squeeze"] == MONITOR
    bench.run_to(6.1)
    assert list(bench.shard.singles) == [1]
    stated = [v for s in statements_of(body for _, body in bench.said(1)) for v in s.verdicts]
    assert {each.monitor for each in stated} == {"squeeze"}
    assert bench.shard.singles[1].machine.outputs.edges
    # Again with an empty RAM, as after a start of the fleet.
    bench.shard = bench.build()
    assert MemberControls(bench.shard, 1).restore(state) == state
    assert MemberControls(bench.shard, 1).apply("monitor", {"monitor": "squeeze", "on": "never"})
    bench.run_to(12.1)
    assert not bench.shard.singles


def test_status_of_a_member_with_a_supply_encloses_its_true_energy(
    make: Callable[..., Bench],
) -> None:
    bench = make(energy={"on": True})
    for instant in range(1, 4):
        bench.run_to(float(instant))
        for row, node in bench.shard.singles.items():
            node.record_status()
            reported = decode(bench.said(row)[-1][1])
            assert isinstance(reported, Status)
            assert reported.energy is not None
            assert node.energy is not None
            assert (
                reported.energy.stored[0]
                <= node.energy.plant.supply.energy
                <= reported.energy.stored[1]
            )


def test_status_of_a_cohort_s_member_equals_a_single_node_s(
    make: Callable[..., Bench], tmp_path: Path
) -> None:
    seated = [
        table("capacitive", position_m=[0.0, 0.02], sampling_Hz=50.0),
        table("touch", id="t09", position_m=[0.01, 0.02], sampling_Hz=50.0),
        table("touch", id="t10", sampling_Hz=50.0),
    ]
    bench = make(taxel=seated)
    single = Single(bench, 1, tmp_path / "single")
    bench.run_to(1.0)
    single.run_to(1.0)
    single.node.record_status()
    alone = decode(single.said()[-1][1])
    reported = decode(bench.shard.status(1, bench.ticks).body)
    assert isinstance(alone, Status)
    assert isinstance(reported, Status)
    # It states the present, which is the machine's own.
    own = replace(reported, capacity=alone.capacity, time=alone.time, uptime=alone.uptime)
    assert own == alone
    single.close()


def test_what_a_failed_commit_undid_is_reported_as_lost(make: Callable[..., Bench]) -> None:
    bench = make()
    MemberControls(bench.shard, 0).apply("calibrate", {})
    outbox, node = bench.shard.outboxes[0], bench.shard.singles[0]
    bench.run_to(1.2)
    kept = len(bench.said(0))
    bench.ticks += 3 * SECOND
    outbox.begin_savepoint()
    with bench.storage.commit():
        node.catch_up()
        bench.storage.db.execute("ROLLBACK")
        bench.storage.db.execute("BEGIN")
    outbox.undo()
    assert len(bench.said(0)) == kept
    bench.run_to(6.0)
    messages = [decode(body) for _, body in bench.said(0)]
    (gap,) = [gap for each in messages if isinstance(each, Statements) for gap in each.gaps]
    assert gap.samples >= 100 * 3
    reported = {message.position.sequence for message in messages}
    for _, first, last in gap.lost:
        reported |= set(range(first, last + 1))
    assert reported == set(range(max(reported) + 1))
    assert outbox.usage()[0] == len(messages)


def test_open_line_is_reported_as_by_a_single_node(
    make: Callable[..., Bench], tmp_path: Path
) -> None:
    broken = table("capacitive", sampling_Hz=50.0, adc_max_A=1e-9)
    bench = make(taxel=[table("touch", sampling_Hz=50.0), broken | {"id": "t02"}])
    single = Single(bench, 1, tmp_path / "single")
    bench.run_to(45.0)
    single.run_to(45.0)
    stated = statements_of(body for _, body in single.said())
    gaps = [gap for each in stated for gap in each.gaps]
    assert [gap.reason for gap in gaps] == ["t02 certainly dead"]
    assert bench.said(1) == single.said()
    assert not bench.shard.singles
    single.close()


@pytest.mark.parametrize(
    ("sections", "named"),
    [
        ({}, None),
        ({"energy": {"on": True}}, "energy"),
        ({"taxel": [table("capacitive", adaptive=True)]}, "taxel.t01.adaptive"),
        ({"monitor": [{"name": "squeeze"} | MONITOR]}, "monitor"),
    ],
)
def test_designs_that_columns_cannot_bear_run_alone(
    make: Callable[..., Bench], sections: dict[str, Any], named: str | None
) -> None:
    bench = make(**sections)
    assert reason_to_sample_alone(bench.settings) == named
    assert len(bench.shard.singles) == (0 if named is None else len(NAMES))
    bench.run_to(1.2)
    assert {FRAME} <= {kind for kind, _ in bench.said(0)}
