"""An outbox on a real flash, for tests."""

from __future__ import annotations

import functools
from typing import TYPE_CHECKING, Any

import numpy as np
from eskin_sensor_node.firmware.assembler import encode
from eskin_sensor_node.firmware.peaks import CERTAIN
from eskin_sensor_node.machine.node_layout import describe
from eskin_sensor_node.node.factory import build_outbox
from eskin_sensor_node.settings import BrokerSection

from eskin.wire.frames import Layout, Patch, Statements
from tests.unit.sensor_node.designs import waiting
from tests.unit.sensor_node.flashes import KEY, open_flash
from tests.unit.sensor_node.messages import decode

if TYPE_CHECKING:
    from pathlib import Path

    from eskin_sensor_node.firmware.chip import Position
    from eskin_sensor_node.firmware.message_writer import Record
    from eskin_sensor_node.firmware.outbox import Batch

    from eskin.wire.frames import Gap

ROOM = 1 << 20
PATCH = Patch("skin", "capacitance", "F", ("t01",), 1e-15)
DESCRIBED = describe(Layout((PATCH.content_hash,), (1,)), (PATCH,))


class Store:
    """An outbox on a flash."""

    def __init__(
        self, path: Path, capacity: int = ROOM, *, key: bytes = KEY, epoch: int = 1
    ) -> None:
        self.flash = open_flash(path, key=key, epoch=epoch)
        broker = BrokerSection(window=10_000)
        self.outbox = build_outbox(
            self.flash, capacity=capacity, broker=broker, described=DESCRIBED
        )

    def add_frame(self, batch: Batch, n: int = 250) -> Record:
        """A frame of n samples, about 3 bytes each."""
        time = self.outbox._sequence, self.outbox._sequence + 5
        grid, patch = (0, 10, 0, n, 1.0), (0, 0, 0, 1, *_noise(n))
        frame = self.outbox.message_writer.frame(
            0, 0, time, [grid], [patch], samples=n, lasting=10 * (n - 1)
        )
        batch.take([frame])
        return frame

    def add_peak(self, batch: Batch) -> Record:
        """A statement of one peak."""
        peak = 0, 0, (0, 9), CERTAIN, (1, 1), (0.0, 1.0), (0.0, 1.0), 1.0
        stated = self.outbox.message_writer.statements((0, 9), peaks=[peak])
        batch.take([stated])
        return stated

    def fill(self, frames: int, *, peak_every: int = 0) -> list[Position]:
        records = []
        for number in range(frames):
            with self.outbox.batch() as batch:
                records.append(self.add_frame(batch))
                if peak_every and number % peak_every == 0:
                    records.append(self.add_peak(batch))
        return [(self.flash.boot, record.sequence) for record in records]

    def positions(self) -> list[Position]:
        return [kept.position for kept in waiting(self.flash)]

    def messages(self) -> list[Any]:
        return [decode(kept.body) for kept in waiting(self.flash)]

    def gaps(self) -> list[Gap]:
        stated = [message for message in self.messages() if isinstance(message, Statements)]
        return [gap for each in stated for gap in each.gaps]

    def read_all(self) -> None:
        """As a radio does that has just connected."""
        self.outbox.connect(0)
        self.outbox.due(0, 10_000)

    def fail_writes(self) -> None:
        """As a full disk does: no page can be added."""
        pages = self.flash.file.db.execute("PRAGMA page_count").fetchone()[0]
        self.flash.file.db.execute(f"PRAGMA max_page_count = {pages}")

    def make_room(self) -> None:
        self.flash.file.db.execute("PRAGMA max_page_count = 1000000")


@functools.cache
def _noise(n: int) -> tuple[int, int, bytes]:
    """Encoded samples that need all bits."""
    lows = np.random.default_rng(n).uniform(0.0, 2.0**23, n)
    return encode(lows.tolist(), (lows + 1.0).tolist(), n, 1, 0, b"", 0)


def plain(message: Any) -> Position:
    return message.position.boot, message.position.sequence
