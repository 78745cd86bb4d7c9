"""A node's flash whose file was damaged: what the outbox does on it."""

from __future__ import annotations

from contextlib import ExitStack
from typing import TYPE_CHECKING

from eskin_sensor_node.node.factory import build_outbox
from eskin_sensor_node.settings import BrokerSection

from eskin.errors import FlashError
from tests.robustness.fuzz.mutations.octets import mutate_image
from tests.robustness.fuzz.target import Target
from tests.unit.sensor_node.flashes import open_flash
from tests.unit.sensor_node.stores import DESCRIBED, Store

if TYPE_CHECKING:
    from pathlib import Path

    from eskin_sensor_node.machine.flash.flash import Flash

_CAPACITY = 1 << 16


def make(folder: Path) -> Target:
    """Only `FlashError`; what is read back has the types that it was written with."""
    whole = folder / "whole.db"
    store = Store(whole)
    store.fill(3, peak_every=1)
    store.flash.file.db.execute("PRAGMA wal_checkpoint(TRUNCATE)")
    store.flash.close()
    path = folder / "flash.db"

    def check(data: bytes) -> None:
        for other in folder.glob("flash.db*"):
            other.unlink()
        path.write_bytes(data)
        with ExitStack() as stack:
            try:
                flash = open_flash(path)
                stack.callback(flash.close)
                _use(flash)
            except FlashError:
                return

    return Target((whole.read_bytes(),), mutate_image, check)


def _use(flash: Flash) -> None:
    outbox = build_outbox(flash, capacity=_CAPACITY, broker=BrokerSection(), described=DESCRIBED)
    outbox.connect(0)
    for kept in outbox.due(0, 100):
        assert isinstance(kept.body, bytes)
        assert all(isinstance(number, int) for number in (*kept.position, *kept.time))
        outbox.mark_sent(kept.position, 1)
    outbox.answer()
    with outbox.batch() as batch:
        batch.take([outbox.message_writer.gap(0, (0, 9), 5)])
    outbox.acknowledge([(flash.boot, 0, 3)])
    outbox.held()
    outbox.restart()
