"""A member that is set says byte for byte what a single node says that is set likewise."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from eskin.errors import CommandError
from eskin.messages import Block, Gap, Status, decode_message
from sensor_node.controls import NodeControls
from sensor_node.firmware.record import BLOCK, PEAK
from sensor_node.flash import Flash
from sensor_node.fleet.controls import MemberControls
from sensor_node.fleet.soloist import require_alone
from sensor_node.fleet.squad import Squad, member_seed
from sensor_node.fleet.storage import Storage
from sensor_node.service import build_node, build_outbox
from sensor_node.truth import Truth
from tests.sensor_node.designs import SECOND, START, settings, table, waiting

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

SEED = 5
NAMES = ["skin-0001", "skin-0002", "skin-0003"]
BOOT = 3


class Bench:
    """A squad without a network, whose time the test turns."""

    def __init__(self, folder: Path, **sections: Any) -> None:
        folder.mkdir(exist_ok=True)
        self.settings = settings(
            folder,
            node={"name": "skin", "profile": "custom"},
            **{
                "taxel": [table("capacitive", sampling_Hz=500.0), table("touch", id="t09")],
                "sampling": {"overrun_s": 1000.0},
            }
            | sections,
        )
        self.ticks = 0
        self.storage = Storage(folder / "fleet.sqlite", NAMES, epoch=BOOT)
        self.truth = Truth(folder / "known.sqlite", limit=2**30)
        self.squad = self.build()

    def build(self) -> Squad:
        return Squad(
            self.settings, NAMES, range(len(NAMES)), seed=SEED, storage=self.storage,
            truth=self.truth, start=START, origin=0, monotonic=lambda: self.ticks,
        )  # fmt: skip

    def run_to(self, seconds: float) -> None:
        """Let time pass in steps, as the fleet's loop does."""
        end = round(seconds * SECOND)
        while self.ticks < end:
            self.ticks = min(self.ticks + SECOND // 5, end)
            while self.squad.due() <= self.ticks:
                self.write(*self.squad.sample(self.ticks))
            for row, node in self.squad.soloists.items():
                if node.due:
                    self.squad.outboxes[row].mark()
                    with self.storage.commit(), self.truth.together():
                        node.catch_up()

    def write(self, records: Any, truth: Any) -> None:
        self.truth.store(truth)
        with self.storage.commit():
            for row, said in records.items():
                outbox = self.squad.outboxes[row]
                outbox.write(said)
                outbox.settle(said)

    def finish(self) -> None:
        self.write(self.squad.finish(), {})
        for node in self.squad.soloists.values():
            node.finish()

    def said(self, row: int) -> list[tuple[int, bytes]]:
        kept = self.storage.partition(NAMES[row]).after((-1, -1), 10**6)
        return [(each.kind, each.body) for each in kept]

    def close(self) -> None:
        self.storage.close()
        self.truth.close()


class Single:
    """The same as one of its members, alone."""

    def __init__(self, bench: Bench, row: int, folder: Path) -> None:
        folder.mkdir()
        own = bench.settings.node.model_copy(update={"seed": member_seed(SEED, row)})
        self.flash = Flash(folder / "flash.sqlite", epoch=BOOT)
        self.truth = Truth(folder / "truth.sqlite", limit=2**30)
        outbox = build_outbox(self.flash, capacity=2**30, broker=bench.settings.broker)
        design = bench.settings.model_copy(update={"node": own})
        self.node, _ = build_node(design, outbox=outbox, truth=self.truth, start=START)
        self.ticks = 0

    def run_to(self, seconds: float) -> None:
        end = round(seconds * SECOND)
        while self.ticks < end:
            self.ticks = min(self.ticks + SECOND // 5, end)
            self.node.advance(self.ticks)

    def said(self) -> list[tuple[int, bytes]]:
        return [(each.kind, each.body) for each in waiting(self.flash)]

    def close(self) -> None:
        self.flash.close()
        self.truth.close()


@pytest.fixture
def make(tmp_path: Path) -> Iterator[Callable[..., Bench]]:
    made: list[Bench] = []

    def build(**sections: Any) -> Bench:
        made.append(Bench(tmp_path / f"fleet-{len(made)}", **sections))
        return made[-1]

    yield build
    for each in made:
        each.close()


COMMANDS: list[list[tuple[float, str, dict[str, Any]]]] = [
    [(1.3, "set", {"threshold": 2e-12, "channel": "t01.capacitance"})],
    [(1.3, "set", {"gain": 1.5}), (2.9, "reset", {})],
    [(2.3, "set", {"smoothing": 0.6, "taxel": "t01"})],
    [(0.7, "set", {"rate": 125.0, "taxel": "t01"}), (2.2, "set", {"mode": "peaks"})],
    [(1.3, "calibrate", {}), (1.5, "set", {"mode": "adaptive"})],
    [(2.3, "set", {"adaptive": "on"})],
]


@pytest.mark.parametrize("orders", COMMANDS, ids=lambda orders: "-".join(o[1] for o in orders))
def test_member_that_is_set_says_what_a_single_node_says(
    make: Callable[..., Bench], tmp_path: Path, orders: list[tuple[float, str, dict[str, Any]]]
) -> None:
    bench = make()
    singles = [Single(bench, row, tmp_path / str(row)) for row in (0, 1)]
    member, alone = MemberControls(bench.squad, 1), NodeControls(singles[1].node)
    assert member.restore({}) == alone.restore({})
    for moment, name, arguments in orders:
        bench.run_to(moment)
        for single in singles:
            single.run_to(moment)
        assert member.apply(name, arguments) == alone.apply(name, arguments)
    bench.run_to(4.1)
    bench.finish()
    for row, single in enumerate(singles):
        single.run_to(4.1)
        single.node.finish()
        assert bench.said(row) == single.said()
        assert {BLOCK, PEAK} <= {kind for kind, _ in bench.said(row)}
        single.close()
    assert list(bench.squad.soloists) == [1]


def test_what_a_member_says_encloses_the_truth_before_and_after(
    make: Callable[..., Bench],
) -> None:
    bench = make()
    controls = MemberControls(bench.squad, 2)
    bench.run_to(1.3)
    controls.apply("set", {"gain": 0.5, "rate": 100.0})
    bench.run_to(8.0)
    periods = set()
    for kind, body in bench.said(2):
        if kind == BLOCK:
            block = decode_message(body)
            assert isinstance(block, Block)
            true = Truth.read(bench.settings.truth.path.with_name("known.sqlite"), [block.position],
                              node=NAMES[2])[block.position]  # fmt: skip
            assert np.all(block.tube.values.contains(true.values))
            assert block.tube.time[0] <= true.time <= block.tube.time[1]
            periods.add(block.tube.dt)
    assert len(periods) == 3


def test_refused_command_leaves_a_member_in_its_cohort(make: Callable[..., Bench]) -> None:
    bench = make()
    controls = MemberControls(bench.squad, 0)
    with pytest.raises(CommandError, match="at most 500"):
        controls.apply("set", {"rate": 501.0})
    assert not bench.squad.soloists


def test_state_is_taken_up_again_and_the_design_needs_nobody_alone(
    make: Callable[..., Bench],
) -> None:
    bench = make()
    state = MemberControls(bench.squad, 0).apply("set", {"gain": 2.0})
    again = bench.squad = bench.build()
    assert MemberControls(again, 0).restore(state) == state
    assert MemberControls(again, 1).restore(again.designed) == again.designed
    assert list(again.soloists) == [0]
    bench.run_to(2.0)


def test_status_of_a_member_with_a_supply_encloses_its_true_energy(
    make: Callable[..., Bench],
) -> None:
    bench = make(energy={"on": True})
    for moment in range(1, 4):
        bench.run_to(float(moment))
        for row, node in bench.squad.soloists.items():
            node.record_status()
            told = decode_message(bench.said(row)[-1][1])
            assert isinstance(told, Status)
            assert told.energy is not None
            assert node.energy is not None
            assert told.energy.stored[0] <= node.energy.plant.supply.energy <= told.energy.stored[1]


def test_what_a_failed_commit_undid_is_told_as_lost(make: Callable[..., Bench]) -> None:
    bench = make()
    MemberControls(bench.squad, 0).apply("calibrate", {})
    outbox, node = bench.squad.outboxes[0], bench.squad.soloists[0]
    bench.run_to(1.2)
    kept = len(bench.said(0))
    bench.ticks += 3 * SECOND
    outbox.mark()
    with bench.storage.commit():
        node.catch_up()
        bench.storage.db.execute("ROLLBACK")
        bench.storage.db.execute("BEGIN")
    outbox.undo()
    assert len(bench.said(0)) == kept
    bench.run_to(6.0)
    messages = [decode_message(body) for _, body in bench.said(0)]
    gap = next(message for message in messages if isinstance(message, Gap))
    assert gap.samples >= 500 * 3
    told = {message.position.sequence for message in messages}
    for _, first, last in gap.lost:
        told |= set(range(first, last + 1))
    assert told == set(range(max(told) + 1))
    assert outbox.usage()[0] == len(messages)


def test_open_line_is_told_as_by_a_single_node(make: Callable[..., Bench], tmp_path: Path) -> None:
    broken = table("capacitive", sampling_Hz=50.0, adc_max_A=1e-9)
    bench = make(taxel=[table("touch", sampling_Hz=50.0), broken | {"id": "t02"}])
    single = Single(bench, 1, tmp_path / "single")
    bench.run_to(45.0)
    single.run_to(45.0)
    gaps = [m for m in map(decode_message, (b for _, b in single.said())) if isinstance(m, Gap)]
    assert [gap.reason for gap in gaps] == ["t02 certainly dead"]
    assert bench.said(1) == single.said()
    assert not bench.squad.soloists
    single.close()


@pytest.mark.parametrize(
    ("sections", "named"),
    [
        ({}, None),
        ({"energy": {"on": True}}, "energy"),
        ({"taxel": [table("capacitive", adaptive=True)]}, "taxel.t01.adaptive"),
    ],
)
def test_designs_that_columns_cannot_bear_run_alone(
    make: Callable[..., Bench], sections: dict[str, Any], named: str | None
) -> None:
    bench = make(**sections)
    assert require_alone(bench.settings) == named
    assert len(bench.squad.soloists) == (0 if named is None else len(NAMES))
    bench.run_to(1.2)
    assert {BLOCK} <= {kind for kind, _ in bench.said(0)}
