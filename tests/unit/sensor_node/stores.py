"""An outbox on a real flash, for tests."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from eskin_sensor_node.firmware.encoding import F64
from eskin_sensor_node.firmware.message_writer import Channel
from eskin_sensor_node.firmware.peaks import CERTAIN, PeakEvent, Span
from eskin_sensor_node.node.factory import build_outbox
from eskin_sensor_node.settings import BrokerSection

from eskin.wire.messages import Gap, decode_message
from tests.unit.sensor_node.designs import waiting
from tests.unit.sensor_node.flashes import KEY, open_flash

if TYPE_CHECKING:
    from pathlib import Path

    from eskin_sensor_node.firmware.chip import Position
    from eskin_sensor_node.firmware.message_writer import Record
    from eskin_sensor_node.firmware.outbox import Batch

ROOM = 1 << 20
CHANNEL = Channel("t01.capacitance", "F", 10, 1.0)
EVENT = PeakEvent(CERTAIN, Span(0, 0.0, 1.0))


class Store:
    """An outbox on a flash."""

    def __init__(
        self, path: Path, capacity: int = ROOM, *, key: bytes = KEY, epoch: int = 1
    ) -> None:
        self.flash = open_flash(path, key=key, epoch=epoch)
        broker = BrokerSection(window=10_000)
        self.outbox = build_outbox(self.flash, capacity=capacity, broker=broker)

    def add_block(self, batch: Batch, n: int = 250) -> Record:
        values = [1.0] * n
        time = self.outbox._sequence, self.outbox._sequence + 5
        block = self.outbox.message_writer.block(CHANNEL, 0, time, F64, values, values, n)
        batch.take([block])
        return block

    def add_peak(self, batch: Batch) -> Record:
        peak = self.outbox.message_writer.peak(CHANNEL, EVENT, (0, 9), 1.0)
        batch.take([peak])
        return peak

    def fill(self, blocks: int, *, peak_every: int = 0) -> list[Position]:
        records = []
        for number in range(blocks):
            with self.outbox.batch() as batch:
                records.append(self.add_block(batch))
                if peak_every and number % peak_every == 0:
                    records.append(self.add_peak(batch))
        return [(self.flash.boot, record.sequence) for record in records]

    def positions(self) -> list[Position]:
        return [kept.position for kept in waiting(self.flash)]

    def messages(self) -> list[Any]:
        return [decode_message(kept.body) for kept in waiting(self.flash)]

    def gaps(self) -> list[Gap]:
        return [message for message in self.messages() if isinstance(message, Gap)]

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


def plain(message: Any) -> Position:
    return message.position.boot, message.position.sequence
