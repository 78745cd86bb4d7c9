"""A fleet's flash file: each node reads its own messages, and reports those that are lost."""

from __future__ import annotations

from contextlib import ExitStack
from typing import TYPE_CHECKING, Any, Final

from eskin_sensor_node.firmware.assembler import encode
from eskin_sensor_node.machine.flash.file import FlashFile
from eskin_sensor_node.machine.flash.flash import Partition
from eskin_sensor_node.node.factory import build_outbox
from eskin_sensor_node.settings import BrokerSection

from eskin.privacy.open_keystore import open_key
from eskin.runtime.settings import KeysSection
from tests.robustness.bitflips.part import Part
from tests.unit.sensor_node.designs import waiting
from tests.unit.sensor_node.messages import stated_gaps
from tests.unit.sensor_node.stores import DESCRIBED

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
    return build_outbox(
        chip, capacity=1 << 20, broker=BrokerSection(window=1000), described=DESCRIBED
    )


def _frame(outbox: Outbox, number: int) -> Record:
    values = [float(number)] * 20
    grid, samples = (0, 10, 0, 20, 1.0), encode(values, values, 20, 1, 0, (), 0)
    return outbox.message_writer.frame(
        0, 0, (number, number + 5), [grid], [(0, 0, 0, 1, *samples)], samples=20, lasting=190
    )


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
                    batch.take([_frame(outbox, number)])
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
    outbox = _outbox(chip)
    for kept in waiting(chip):
        if not stated_gaps(kept):
            yield f"message {kept.position}", (kept.body, kept.time, kept.samples)
    yield "answer", chip.answer()
    for boot, last in chip.ended():
        yield f"end of {boot}", last
    if charge := chip.charge():
        yield "charge", charge
    outbox.connect(0)
    for kept in outbox.due(0, 100):
        outbox.mark_sent(kept.position, 1)
    with outbox.batch() as batch:
        batch.take([outbox.message_writer.gap(0, (0, 9), 5)])
    outbox.acknowledge([(chip.boot, 0, 3)])


PART: Final = Part(make, read, (_FLASH, f"{_KEYS}/*"))
