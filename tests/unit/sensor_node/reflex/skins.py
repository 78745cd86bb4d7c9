"""A node of a real skin without a network, whose time the test turns."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from eskin_sensor_node.columns import build
from eskin_sensor_node.firmware.message_writer import STATEMENTS
from eskin_sensor_node.machine.node_layout import describe
from eskin_sensor_node.node.factory import build_outbox
from eskin_sensor_node.node.ground_truth import GroundTruth
from eskin_sensor_node.skin_node.controls import SkinControls
from eskin_sensor_node.skin_node.node import SkinNode

from eskin.wire.frames import MonitorVerdict, Statements
from tests.unit.sensor_node.designs import SECOND, clock_at, waiting
from tests.unit.sensor_node.flashes import open_flash

if TYPE_CHECKING:
    from pathlib import Path

    from eskin_sensor_node.columns import PadColumns
    from eskin_sensor_node.settings import NodeSettings
    from numpy.typing import NDArray

SEED = 7


class SkinBench:
    """The node."""

    def __init__(self, folder: Path, node: NodeSettings, *, drift: int = 0) -> None:
        self.settings = node
        self.truth = GroundTruth(folder / "truth.sqlite", limit=node.truth.limit_bytes)
        self.flash = open_flash(folder / "flash.sqlite", node=node.node.name, epoch=1)
        self.ticks = 0
        self.clock = clock_at(lambda: self.ticks, drift=drift)
        columns = self._columns(0)
        self.outbox = build_outbox(
            self.flash,
            capacity=node.flash.capacity_bytes,
            broker=node.broker,
            described=describe(columns.layout, columns.patches),
        )
        self.node = SkinNode(
            node,
            clock=self.clock,
            outbox=self.outbox,
            truth=self.truth,
            seed=SEED,
            build=self._columns,
        )
        self.controls = SkinControls(self.node)

    def _columns(self, boot: int) -> PadColumns:
        return build(self.settings, SEED, boot=boot, clock=self.clock)

    def run_to(self, seconds: float) -> None:
        end = round(seconds * SECOND)
        while self.ticks < end:
            self.ticks = min(self.ticks + SECOND // 10, end)
            self.node.advance(self.ticks)

    def verdicts(self) -> list[MonitorVerdict]:
        kept = [each.body for each in waiting(self.flash) if each.kind == STATEMENTS]
        return [each for body in kept for each in Statements.decode(body).verdicts]

    def levels(self, samples: int) -> NDArray[np.bool_]:
        """Whether the output was on after each row."""
        found = np.zeros(samples, bool)
        for edge in self.node.machine.outputs.edges:
            row = (edge.cause - self.node.machine.booted) // self.node.columns.period
            found[row:] = edge.level
        return found

    def close(self) -> None:
        self.flash.close()
        self.truth.close()
