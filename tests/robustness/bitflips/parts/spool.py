"""A gateway's spool: what waits for the cloud, and what the gateway remembers of its nodes."""

from __future__ import annotations

import shutil
from contextlib import closing
from functools import cache
from pathlib import Path
from tempfile import mkdtemp
from typing import TYPE_CHECKING, Any, Final

from eskin.wire.messages import Position
from eskin.wire.topics import Stream
from tests.robustness.bitflips.part import Part
from tests.support.identities import Identities
from tests.unit.gateway.in_memory import Inside
from tests.unit.gateway.messages import result, status
from tests.unit.gateway.skins import LARGE
from tests.unit.gateway.wire_node import Seal

if TYPE_CHECKING:
    from collections.abc import Iterator

_SPOOL: Final = "spool.db"
_NODE: Final = "fingertip"
_SKIN: Final = LARGE
_SAID: Final = 30
_NEVER_SAID: Final = [
    (boot, n) for boot in (1, 2) for n in range(90) if boot == 2 or n >= _SAID or n % 5 == 4
]


@cache
def _identities() -> Identities:
    return Identities(Path(mkdtemp(prefix="eskin-bitflips-")))


@cache
def _seal() -> Seal:
    return Seal(_identities().node, _identities().site)


def _envelope(stream: Stream, message: Any) -> bytes:
    return _seal()(_NODE, stream, message.encode(), introduce=stream is Stream.STATUS)


def make(folder: Path) -> None:
    """Messages of a node: its certificate, skin, frames, statements, and an unreadable one."""
    inside = Inside(folder, _identities())
    with closing(inside.spool):
        inside.arrive(Stream.STATUS, _envelope(Stream.STATUS, status(0)))
        for each in _SKIN.descriptions:
            inside.arrive(Stream.LAYOUTS, _seal()(_NODE, Stream.LAYOUTS, each))
        for number in range(1, _SAID):
            if number % 5 == 4:
                continue
            if number % 7 in {1, 2}:
                said = _SKIN.statements if number % 7 == 1 else _SKIN.peaks
                inside.arrive(Stream.EVENTS, _envelope(Stream.EVENTS, said(number)))
            else:
                inside.arrive(Stream.FRAMES, _envelope(Stream.FRAMES, _SKIN.frame(number)))
        inside.arrive(Stream.EVENTS, _seal()(_NODE, Stream.EVENTS, b"poison"))
        taken = inside.spool.take(5, 1 << 20)
        inside.spool.settle(taken, confirmed=taken)
        inside.spool._ingest.execute("PRAGMA wal_checkpoint(TRUNCATE)")
    shutil.rmtree(folder / "keys")


def read(folder: Path) -> dict[str, Any]:
    """Open it, take what waits, and have the node say more and some of it again."""
    inside = Inside(folder, _identities())
    with closing(inside.spool) as spool:
        found: dict[str, Any] = {}
        for stored in spool.take(1000, 1 << 30):
            found[f"message {stored.boot} {stored.sequence}"] = stored[:5]
        for name in _SKIN.hashes:
            if body := spool.description(_NODE, name):
                found[f"description {name.hex()}"] = body
        record = inside.node_states[_NODE]
        found["seen"] = [place for place in _NEVER_SAID if record.is_duplicate(Position(*place))]
        found |= dict(_later(inside))
        return found


def _later(inside: Inside) -> Iterator[tuple[str, Any]]:
    """What becomes of what comes now: new numbers must be stored."""
    before = len(inside.spool.take(1000, 1 << 30))
    inside.arrive(Stream.EVENTS, _envelope(Stream.EVENTS, result(70, 1)))
    if not inside.rejected():
        yield "new is stored", len(inside.spool.take(1000, 1 << 30)) - before
    inside.arrive(Stream.STATUS, _envelope(Stream.STATUS, status(71)))
    inside.arrive(Stream.EVENTS, _envelope(Stream.EVENTS, result(72, 2)))
    inside.arrive(Stream.FRAMES, _envelope(Stream.FRAMES, _SKIN.frame(73)))
    for each in _SKIN.descriptions:
        inside.arrive(Stream.LAYOUTS, _seal()(_NODE, Stream.LAYOUTS, each))
    inside.arrive(Stream.FRAMES, _envelope(Stream.FRAMES, _SKIN.frame(73)))
    taken = inside.spool.take(1000, 1 << 30)
    yield "frame is stored", any(stored.sequence == 73 for stored in taken)
    yield "known again", any(stored.sequence == 72 for stored in taken)
    inside.spool.dead_letters()
    for name in inside.spool.nodes():
        inside.spool.node(name)
    inside.spool.settle(taken, confirmed=taken)
    yield "empties", len(inside.spool.take(1000, 1 << 30))


PART: Final = Part(make, read, (_SPOOL,))
