"""A fleet's flash file: each node reads its own messages, and reports those that are lost."""

from __future__ import annotations

from contextlib import ExitStack
from typing import TYPE_CHECKING, Any, Final

from eskin_sensor_node.firmware.encoding import F64
from eskin_sensor_node.firmware.message_writer import GAP
from eskin_sensor_node.machine.flash.file import FlashFile
from eskin_sensor_node.machine.flash.flash import Partition
from eskin_sensor_node.node.factory import build_outbox
from eskin_sensor_node.settings import BrokerSection

from eskin.privacy.open_keystore import open_key
from eskin.runtime.settings import KeysSection
from eskin.wire.messages import Gap, decode_message
from tests.robustness.bitflips.part import Part
from tests.unit.sensor_node.designs import waiting
from tests.unit.sensor_node.stores import CHANNEL

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from eskin_sensor_node.firmware.message_writer import Record
    from eskin_sensor_node.firmware.outbox import Outbox

_FLASH: Final = "flash.sqlite"
_KEYS: Final = "keys"
_NAMES: Final = ("sole-0001", "sole-0002", "sole-0003")
_BOOTS: Final = (1_800_000_000, 1_800_000_600)
_NOW: Final = 1_800_001_200


def _open(folder: Path, epoch: int) -> FlashFile:
    key = open_key(KeysSection(), folder / _KEYS, "flash.key")
    return FlashFile(folder / _FLASH, _NAMES, key=key, epoch=epoch)


def _outbox(chip: Partition) -> Outbox:
    return build_outbox(chip, capacity=1 << 20, broker=BrokerSection(window=1000))


def _block(outbox: Outbox, number: int) -> Record:
    values = [float(number)] * 20
    return outbox.message_writer.block(CHANNEL, 0, (number, number + 5), F64, values, values, 20)


def make(folder: Path) -> None:
    """Three nodes fill a file in two boots; each has an answer and a charge."""
    for epoch in _BOOTS:
        file = _open(folder, epoch)
        for name in _NAMES:
            chip = Partition(file, name)
            outbox = _outbox(chip)
            with outbox.batch() as batch:
                batch.take([outbox.message_writer.gap(0, (0, 9), 5)])
            for number in range(6):
                with outbox.batch() as batch:
                    batch.take([_block(outbox, number)])
            chip.store_answer(f"the last result of {name}".encode())
            chip.store_charge(f"the charge of {name}".encode())
        file.db.execute("PRAGMA wal_checkpoint(TRUNCATE)")
        file.close()


def read(folder: Path) -> dict[str, Any]:
    """Open it, read what each node has, and add a message to each."""
    with ExitStack() as stack:
        file = _open(folder, _NOW)
        stack.callback(file.close)
        found: dict[str, Any] = {}
        for name in _NAMES:
            found |= {f"{name} {what}": value for what, value in _read(Partition(file, name))}
        return found


def _read(chip: Partition) -> Iterator[tuple[str, Any]]:
    yield "gaps", chip.gaps()
    yield "boot is new", chip.boot > max(_BOOTS)
    for kept in waiting(chip):
        if kept.kind == GAP:
            assert isinstance(decode_message(kept.body), Gap)
        else:
            yield f"message {kept.position}", (kept.body, kept.time, kept.samples)
    yield "answer", chip.answer()
    for boot, last in chip.ended():
        yield f"end of {boot}", last
    if charge := chip.charge():
        yield "charge", charge
    outbox = _outbox(chip)
    outbox.connect(0)
    for kept in outbox.due(0, 100):
        outbox.mark_sent(kept.position, 1)
    with outbox.batch() as batch:
        batch.take([outbox.message_writer.gap(0, (0, 9), 5)])
    outbox.acknowledge([(chip.boot, 0, 3)])


PART: Final = Part(make, read, (_FLASH, f"{_KEYS}/*"))
