"""A node's flash: batches, acknowledgements, and frames that give way because it is full."""

from __future__ import annotations

import hashlib
import sqlite3
from contextlib import closing
from typing import TYPE_CHECKING, Any, Final

from eskin.privacy.subject import KEY_BYTES
from tests.unit.sensor_node.designs import waiting
from tests.unit.sensor_node.flashes import open_flash
from tests.unit.sensor_node.messages import stated_gaps
from tests.unit.sensor_node.stores import DESCRIBED, Store

if TYPE_CHECKING:
    import random
    from pathlib import Path

    from eskin_sensor_node.firmware.chip import Position

    from tests.robustness.powercut.journal import Marks

_NAME: Final = "flash.sqlite"
_KEY: Final = bytes(KEY_BYTES)
"""Another process looks at what a cut has left."""
_ROOM: Final = 400_000
_BATCHES: Final = 130


def work(folder: Path, draw: random.Random, marks: Marks) -> None:
    """Live a node's life, with a restart in its middle."""
    for _ in range(2):
        store = Store(folder / _NAME, _ROOM, key=_KEY)
        marks.tell("boot", store.flash.boot)
        said: list[Position] = []
        for _ in range(_BATCHES):
            with store.outbox.batch() as batch:
                for _ in range(draw.randint(1, 14)):
                    store.add_frame(batch, draw.randint(50, 250))
                    if draw.random() < 0.2:
                        store.add_peak(batch)
                for record in batch.records:
                    marks.tell("will", store.flash.boot, record.sequence, _digest(record.body))
            new = [(store.flash.boot, record.sequence) for record in batch.records]
            marks.tell("did", *new)
            said += new
            if draw.random() < 0.5:
                store.read_all()
                gone = draw.sample(said, min(len(said), draw.randint(1, 30)))
                marks.tell("forgets", *gone)
                store.outbox.acknowledge([(boot, n, n) for boot, n in gone])
        store.flash.close()


def check(folder: Path, marks: list[list[Any]]) -> None:
    """Whatever a batch's end made durable is there, or a gap names it; nothing else is."""
    will = {(boot, n): digest for what, w in marks if what == "will" for boot, n, digest in [w]}
    did, forgets = (
        {tuple(place) for what, places in marks if what == kind for place in places}
        for kind in ("did", "forgets")
    )
    with closing(open_flash(folder / _NAME, key=_KEY)) as flash:
        flash.store_descriptions(*DESCRIBED)
        found = waiting(flash)
        boot = flash.boot
    assert boot > max((which[0] for what, which in marks if what == "boot"), default=0)
    named = set()
    for kept in found:
        gaps = stated_gaps(kept)
        for gap in gaps:
            named |= {(b, n) for b, first, last in gap.lost for n in range(first, last + 1)}
        if not gaps:
            assert will[kept.position] == _digest(kept.body), f"{kept.position} is corrupt"
    there = {kept.position for kept in found}
    assert not (lost := did - forgets - there - named), f"vanished: {sorted(lost)[:5]}"
    assert not (twice := there & named), f"there, and stated as lost: {sorted(twice)[:5]}"
    with closing(sqlite3.connect(folder / _NAME)) as database:
        assert database.execute("PRAGMA integrity_check").fetchall() == [("ok",)]


def _digest(body: bytes) -> str:
    return hashlib.sha256(body).hexdigest()[:16]
