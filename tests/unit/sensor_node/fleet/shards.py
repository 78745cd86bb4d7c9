"""A shard without a network, and its members as single nodes, for tests."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from eskin_sensor_node.fleet.member import MemberControls
from eskin_sensor_node.fleet.shard import Shard, member_seed
from eskin_sensor_node.machine.flash.file import FlashFile
from eskin_sensor_node.machine.flash.flash import Partition
from eskin_sensor_node.machine.node_layout import plan_layout
from eskin_sensor_node.node.commands import NodeControls
from eskin_sensor_node.node.factory import build_node, build_outbox
from eskin_sensor_node.node.ground_truth import GroundTruth

from tests.unit.sensor_node.designs import SECOND, START, settings, table, waiting
from tests.unit.sensor_node.flashes import KEY, open_flash

if TYPE_CHECKING:
    from pathlib import Path

    from eskin_sensor_node.fleet.cohort import Cohort

SEED = 5
NAMES = ["skin-0001", "skin-0002", "skin-0003"]
BOOT = 3
GAUSSIAN = {"kind": "gaussian", "sigma": 1e-7, "k": 6.0}
DESIGN: dict[str, Any] = {
    "taxel": [
        table("capacitive", sampling_Hz=100.0),
        table("touch", id="t09", sampling_Hz=50.0, noise=GAUSSIAN),
    ],
    "sampling": {"overrun_s": 1000.0, "stretch_ms": 250.0},
}
"""Seldom sampled: single nodes calculate in Python."""


class Bench:
    """A shard without a network, whose time the test turns."""

    def __init__(self, folder: Path, **sections: Any) -> None:
        folder.mkdir(exist_ok=True)
        self.settings = settings(
            folder,
            node={"name": "skin", "profile": "custom"},
            **DESIGN | sections,
        )
        self.ticks = 0
        self.storage = FlashFile(folder / "fleet.sqlite", NAMES, key=KEY, epoch=BOOT)
        self.truth = GroundTruth(folder / "known.sqlite", limit=2**30)
        self.shard = self.build()

    def build(self) -> Shard:
        return Shard(
            self.settings, NAMES, range(len(NAMES)), seed=SEED, storage=self.storage,
            truth=self.truth, start=START, origin=0, monotonic=lambda: self.ticks,
        )  # fmt: skip

    def run_to(self, seconds: float) -> None:
        """Let time pass in steps, as the fleet's loop does."""
        end = round(seconds * SECOND)
        while self.ticks < end:
            self.ticks = min(self.ticks + SECOND // 5, end)
            self.shard.regroup()
            while self.shard.due() <= self.ticks:
                self.write(*self.shard.sample(self.ticks))
            for row, node in self.shard.singles.items():
                if node.due:
                    self.shard.outboxes[row].begin_savepoint()
                    with self.storage.commit(), self.truth.together():
                        node.catch_up()

    def write(self, records: Any, truth: Any) -> None:
        self.truth.store(truth)
        with self.storage.commit():
            for row, said in records.items():
                outbox = self.shard.outboxes[row]
                stated = outbox.pending_gap() + said
                outbox.write(stated)
                outbox.settle(stated)

    def finish(self) -> None:
        self.write(self.shard.finish(), {})
        for node in self.shard.singles.values():
            node.finish()

    def controls(self, row: int) -> MemberControls:
        return MemberControls(self.shard, row)

    def cohort(self, row: int) -> Cohort:
        """The members that sample with a member."""
        return next(cohort for cohort in self.shard.cohorts if row in cohort)

    def said(self, row: int) -> list[tuple[int, bytes]]:
        kept = Partition(self.storage, NAMES[row]).after((-1, -1), 10**6)
        return [(each.kind, each.body) for each in kept]

    def close(self) -> None:
        self.storage.close()
        self.truth.close()


class Single:
    """The same as one of its members, alone."""

    def __init__(self, bench: Bench, row: int, folder: Path) -> None:
        folder.mkdir()
        own = bench.settings.node.model_copy(update={"seed": member_seed(SEED, row)})
        self.flash = open_flash(folder / "flash.sqlite", epoch=BOOT)
        self.truth = GroundTruth(folder / "truth.sqlite", limit=2**30)
        outbox = build_outbox(
            self.flash,
            capacity=2**30,
            broker=bench.settings.broker,
            described=plan_layout(bench.settings).described,
        )
        design = bench.settings.model_copy(update={"node": own})
        self.ticks = 0
        self.node, clock = build_node(design, outbox=outbox, truth=self.truth, start=START)
        clock._monotonic, clock._origin = lambda: self.ticks, 0
        self.controls = NodeControls(self.node)

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
