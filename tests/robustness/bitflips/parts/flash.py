"""A node's flash, with the key that seals it: what waits there, and what the node says next."""

from __future__ import annotations

from contextlib import ExitStack
from typing import TYPE_CHECKING, Any, Final

from eskin_sensor_node.node.factory import build_outbox
from eskin_sensor_node.settings import BrokerSection

from eskin.privacy.open_keystore import open_key
from eskin.runtime.settings import KeysSection
from tests.robustness.bitflips.part import Part
from tests.unit.eskin.wire.frames import examples
from tests.unit.sensor_node.designs import waiting
from tests.unit.sensor_node.flashes import open_flash
from tests.unit.sensor_node.messages import stated_gaps
from tests.unit.sensor_node.stores import DESCRIBED, Store

if TYPE_CHECKING:
    from pathlib import Path

    from eskin_sensor_node.machine.flash.flash import Flash

_FLASH: Final = "flash.sqlite"
_KEYS: Final = "keys"
_BOOTS: Final = (1_800_000_000, 1_800_000_600)
_DESCRIBED: Final = {
    each.content_hash: each.encode() for each in (*examples.PATCHES, examples.LAYOUT)
}
_NOW: Final = 1_800_001_200
"""Boots are numbered by the second in which they begin."""


def make(folder: Path) -> None:
    """Fill a flash in two boots, with descriptions, a result and a charge."""
    key = open_key(KeysSection(), folder / _KEYS, "flash.key")
    for epoch in _BOOTS:
        store = Store(folder / _FLASH, key=key, epoch=epoch)
        store.outbox.describe(examples.LAYOUT.content_hash, _DESCRIBED)
        store.fill(12, peak_every=3)
        store.flash.store_answer(b"the last result")
        store.flash.store_charge(b"the charge")
        store.flash.file.db.execute("PRAGMA wal_checkpoint(TRUNCATE)")
        store.flash.close()


def read(folder: Path) -> dict[str, Any]:
    """Open it, read all that waits, and add a message."""
    key = open_key(KeysSection(), folder / _KEYS, "flash.key")
    with ExitStack() as stack:
        flash = open_flash(folder / _FLASH, key=key, epoch=_NOW)
        stack.callback(flash.close)
        found: dict[str, Any] = {"boot is new": flash.boot > max(_BOOTS)}
        for name in flash.descriptions():
            if body := flash.description(name):
                found[f"description {name.hex()}"] = body
        flash.store_descriptions(*DESCRIBED)
        lost: set[tuple[int, int]] = set()
        for kept in waiting(flash):
            gaps = stated_gaps(kept)
            for gap in gaps:
                lost |= {(b, n) for b, first, last in gap.lost for n in range(first, last + 1)}
            if not gaps:
                found[f"message {kept.position}"] = (kept.body, kept.time, kept.samples)
        found["answer"] = flash.answer()
        found |= {f"end of {boot}": last for boot, last in flash.ended()}
        if charge := flash.charge():
            found["charge"] = charge
        _say(flash)
        return found


def _say(flash: Flash) -> None:
    outbox = build_outbox(
        flash, capacity=1 << 20, broker=BrokerSection(window=1000), described=DESCRIBED
    )
    outbox.connect(0)
    for kept in outbox.due(0, 100):
        outbox.mark_sent(kept.position, 1)
    with outbox.batch() as batch:
        batch.take([outbox.message_writer.gap(0, (0, 9), 5)])
    outbox.describe(examples.LAYOUT.content_hash, _DESCRIBED)
    outbox.acknowledge([(flash.boot, 0, 3)])
    outbox.held()


PART: Final = Part(make, read, (_FLASH, f"{_KEYS}/*"))
