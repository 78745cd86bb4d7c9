"""A node of a tiny skin without a network, whose time the test turns."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from eskin_sensor_node.columns.stretch import PatchColumns, SkinStretch
from eskin_sensor_node.firmware.message_writer import FRAME, STATEMENTS
from eskin_sensor_node.firmware.schedule import Frame as Sampled
from eskin_sensor_node.machine.node_layout import describe
from eskin_sensor_node.node.factory import build_outbox
from eskin_sensor_node.node.ground_truth import GroundTruth, TrueFrame
from eskin_sensor_node.skin_node.controls import SkinControls
from eskin_sensor_node.skin_node.node import SkinNode

from eskin.wire.frames import Frame, Grid, Layout, Patch, Statements
from tests.unit.sensor_node.designs import SECOND, clock_at, settings, waiting
from tests.unit.sensor_node.flashes import open_flash

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    from eskin_sensor_node.columns.taxel import ColumnTaxel
    from eskin_sensor_node.firmware.chip import StoredMessage

    from eskin.wire.messages import Position

STRETCH = SECOND // 10
PERIOD = SECOND // 50
PATCHES = (
    Patch("air", "temperature", "Cel", ("a1",), 0.5, skew=(3_000_000,)),
    Patch("palm", "pressure", "Pa", ("t1", "t2", "t3"), 64.0),
    Patch("thumb", "pressure", "Pa", ("t4",), 64.0),
)
LAYOUT = Layout(tuple(patch.content_hash for patch in PATCHES), pages=(2, 1))


class TinyColumns:
    """Three patches on two pages; one is sampled once a stretch, and a sample is unknown."""

    layout = LAYOUT
    patches = PATCHES
    taxels: ClassVar[dict[str, ColumnTaxel]] = {}
    """None of them can be read one by one."""

    def __init__(self, boot: int) -> None:
        self.period = PERIOD
        self.next_start = 0
        self.row = 0
        self.stretches = 0
        self.broken: list[tuple[str, int, int]] = []
        self._random = np.random.default_rng(boot)

    @property
    def rows(self) -> int:
        return STRETCH // self.period

    @property
    def next_due(self) -> int:
        return self.next_start + self.rows * self.period

    @property
    def frame(self) -> Sampled:
        return Sampled(
            self.row, self.next_start, 0, self.rows, self.period, self.next_due, closes=False
        )

    def sample_every(self, period: int) -> None:
        self.period = period

    def examine(self) -> Sequence[tuple[str, int, int]]:
        return self.broken

    def advance(self, ticks: int) -> Iterator[SkinStretch]:
        while self.next_due <= ticks:
            begin, end = self.next_start, self.next_due
            fast = Grid(0, self.period, self.row, self.rows, 0.999)
            slow = Grid(self.period // 2, end - begin, self.stretches, 1, 1.0)
            cells = ((0, 1, 1), (1, 0, 3), (2, 0, 1))
            patches = [
                self._patch(number, grid, ((fast, slow)[grid].rows, columns))
                for number, grid, columns in cells
            ]
            self._pass()
            yield SkinStretch(begin, end, (fast, slow), patches)

    def skip(self, ticks: int) -> int:
        lost = 0
        while self.next_start < ticks:
            lost += 4 * self.rows + 1
            self._pass()
        return lost

    def _pass(self) -> None:
        self.row, self.stretches = self.row + self.rows, self.stretches + 1
        self.next_start = self.next_due

    def _patch(self, number: int, grid: int, shape: tuple[int, int]) -> PatchColumns:
        truth = self._random.normal(size=shape) * 1e4
        lo, hi = truth - 50.0 * self._random.random(shape), truth + 50.0
        lo[self._random.random(shape) < 0.05] = -np.inf
        return PatchColumns(number, grid, 0, lo, hi, truth)


class SkinBench:
    """A node of that skin.

    Args:
        folder: Where it lives.
        drift: Of its crystal, in parts of 1e9.
        build: Its columns.
        sections: Changes of its settings.
    """

    def __init__(
        self,
        folder: Path,
        *,
        drift: int = 20_000,
        build: type[TinyColumns] = TinyColumns,
        **sections: Any,
    ) -> None:
        self.settings = settings(folder, "paper-hand", **sections)
        self.truth = GroundTruth(self.settings.truth.path, limit=self.settings.truth.limit_bytes)
        self.flash = open_flash(self.settings.flash.path, node="paper-hand", epoch=1)
        self.outbox = build_outbox(
            self.flash,
            capacity=self.settings.flash.capacity_bytes,
            broker=self.settings.broker,
            described=describe(build.layout, build.patches),
        )
        self.ticks = 0
        self.clock = clock_at(lambda: self.ticks, drift=drift)
        self.node = SkinNode(
            self.settings,
            clock=self.clock,
            outbox=self.outbox,
            truth=self.truth,
            seed=7,
            build=build,
        )
        self.controls = SkinControls(self.node)

    @property
    def columns(self) -> TinyColumns:
        """Those of the latest boot."""
        assert isinstance(self.node.columns, TinyColumns)
        return self.node.columns

    def run_to(self, seconds: float) -> None:
        """Let time pass stretch by stretch."""
        end = round(seconds * SECOND)
        while self.ticks < end:
            self.ticks = min(self.ticks + STRETCH, end)
            self.node.advance(self.ticks)

    def waiting(self) -> list[StoredMessage]:
        """All messages in flash."""
        return waiting(self.flash)

    def frames(self) -> list[Frame]:
        """Those that wait, by position."""
        return [Frame.decode(kept.body) for kept in self.waiting() if kept.kind == FRAME]

    def statements(self) -> list[Statements]:
        """Those that wait, by position."""
        kept = [each for each in self.waiting() if each.kind == STATEMENTS]
        return [Statements.decode(each.body) for each in kept]

    def truths(self) -> dict[Position, TrueFrame]:
        """The truth behind all frames that wait."""
        positions = [frame.position for frame in self.frames()]
        return GroundTruth.read_frames(self.settings.truth.path, positions, node="paper-hand")

    def close(self) -> None:
        self.flash.close()
        self.truth.close()
