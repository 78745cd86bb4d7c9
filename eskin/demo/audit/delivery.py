"""Whether all frames that a node made are stored, under way, or reported as lost."""

from __future__ import annotations

import sqlite3
from collections import defaultdict
from contextlib import closing
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

from eskin_cloud.store.damage import DamagedRow, report_damaged
from eskin_cloud.store.schema.node_key import of_node, of_same_node
from eskin_cloud.store.schema.tables import events, sequences
from eskin_cloud.store.write.duplicates import find_digest
from eskin_sensor_node.node.ground_truth import GroundTruth
from sqlalchemy import and_, exists, select

from eskin.demo.audit.frames import removed_frames
from eskin.errors import AuditError
from eskin.privacy import SealedMessage, is_sealed
from eskin.runtime.digest import digest
from eskin.wire.frames import Statements
from eskin.wire.messages import Kind, Position
from eskin.wire.messages.cbor_map import MOST_COUNT, load
from eskin.wire.messages.header import read_position
from eskin.wire.sequence_set import SequenceRanges

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence
    from pathlib import Path

    from sqlalchemy import Connection

    from eskin.demo.audit.frames import StoredFrames
    from eskin.demo.layout import DemoFolder
    from eskin.wire.frames import Gap

_WAITING: Final = (
    "SELECT name, message.boot, sequence FROM message JOIN member ON member.id = message.member"
)
_ENDED: Final = "SELECT name, ended.boot, last FROM ended JOIN member ON member.id = ended.member"


@dataclass(frozen=True, slots=True)
class Delivery:
    """Where the frames of one node are.

    Attributes:
        node: The node.
        made: Those whose truth the emulator keeps.
        stored: Those that the cloud stored.
        waiting: Those that wait in flash or spool.
        lost: Those that a gap reports.
        unborn: Those at the end of a boot that never came to be committed to flash.
        removed: Those that the cloud had, and removed by their age or with their subject.
        missing: All others. Not one may be.
    """

    node: str
    made: int
    stored: int
    waiting: int
    lost: int
    unborn: int
    removed: int
    missing: tuple[Position, ...]

    @property
    def passes(self) -> bool:
        """Whether nothing vanished silently."""
        return not self.missing


class Sightings:
    """Positions by boot."""

    def __init__(self, positions: Iterable[tuple[int, int]] = ()) -> None:
        self._boots: dict[int, SequenceRanges] = defaultdict(SequenceRanges)
        for boot, sequence in positions:
            self._boots[boot].add(sequence)

    def __contains__(self, position: Position) -> bool:
        return position.sequence in self._boots[position.boot]

    def span(self, boot: int, first: int, last: int) -> None:
        """Take in a span."""
        self._boots[boot].add(first, last)

    def last(self, boot: int) -> int:
        """The greatest sequence of a boot; -1 if there is none."""
        return max((last for _, last in self._boots[boot]), default=-1)


@dataclass(frozen=True, slots=True)
class UnderWay:
    """What one look at truth, flash and spool showed; taken before the look at the store.

    Messages only move downstream, so what has left one place by then shows up in the next.
    """

    truths: dict[str, Path]
    made: dict[str, list[Position]]
    settled: dict[str, dict[int, int]]
    ended: dict[str, dict[int, int]]
    waiting: dict[str, Sightings]
    letters: list[str]
    departures: dict[str, list[str]]

    @classmethod
    def look(cls, layout: DemoFolder) -> UnderWay:
        """Look at the demo's files, also while it runs.

        Raises:
            AuditError: One of them cannot be read.
        """
        truths: dict[str, Path] = {}
        made: dict[str, list[Position]] = {}
        settled: dict[str, dict[int, int]] = {}
        departures: dict[str, list[str]] = {}
        for path in layout.truths:
            found = GroundTruth.made(path)
            made |= found
            settled |= GroundTruth.settled(path)
            departures |= GroundTruth.departures(path)
            truths |= dict.fromkeys(found, path)
        # Before what waits there: what flash comes to hold meanwhile is found further on.
        ended: dict[str, dict[int, int]] = defaultdict(dict)
        for node, boot, last in _in_flash(layout, _ENDED):
            ended[node][boot] = last
        waiting = {node: Sightings() for node in made}
        for node, boot, sequence in _in_flash(layout, _WAITING):
            if node in waiting:
                waiting[node].span(boot, sequence, sequence)
        for node, body in _rows(layout.spool, "SELECT node, body FROM messages"):
            position = _position(bytes(body))
            if node in waiting:
                waiting[node].span(position.boot, position.sequence, position.sequence)
        letters = _rows(layout.spool, "SELECT node, reason FROM dead_letters ORDER BY id")
        reasons = [f"{node}: {reason}" for node, reason in letters]
        return cls(truths, made, settled, dict(ended), waiting, reasons, departures)

    def kept(self, node: str, boot: int) -> int:
        """The number below which all of a boot was in flash at some time, or is named by a gap.

        A flash that knows of less than the emulator saw in it is an older copy: then nothing is
        known of what came last, and nothing is excused.
        """
        settled = self.settled.get(node, {}).get(boot, 0)
        last = self.ended.get(node, {}).get(boot)
        if last is None:
            return settled
        return last + 1 if last + 1 >= settled else MOST_COUNT


def deliveries(
    seen: UnderWay, connection: Connection, framed: Mapping[str, StoredFrames]
) -> list[Delivery]:
    """Look for every frame that the nodes made, in what was seen and in the store.

    Args:
        seen: What was seen.
        connection: Reads the store.
        framed: What the store holds of each node's frames.
    """
    return [_delivery(node, seen, connection, framed.get(node)) for node in seen.made]


def _delivery(
    node: str, seen: UnderWay, connection: Connection, framed: StoredFrames | None
) -> Delivery:
    stored = Sightings(sorted(framed.complete) if framed is not None else ())
    lost, sighted = _lost(node, connection), _sighted(node, connection)
    waiting = seen.waiting[node]
    counts = {"stored": 0, "waiting": 0, "lost": 0, "unborn": 0}
    gone = []
    missing = []
    places = (stored, lost, sighted, waiting)
    boots = {position.boot for position in seen.made[node]}
    ends = {boot: max(place.last(boot) + 1 for place in places) for boot in boots}
    kept = {boot: max(end, seen.kept(node, boot)) for boot, end in ends.items()}
    for position in seen.made[node]:
        if position in stored:
            counts["stored"] += 1
        elif position in lost:
            counts["lost"] += 1
        elif position in waiting:
            counts["waiting"] += 1
        elif position.sequence >= kept[position.boot]:
            counts["unborn"] += 1
        elif position in sighted:
            gone.append(position)
        else:
            missing.append(position)
    parts = {} if framed is None else framed.parts
    excused = removed_frames(seen.truths[node], connection, node, gone, parts)
    missing += [position for position in gone if position not in excused]
    return Delivery(
        node=node,
        made=len(seen.made[node]),
        removed=len(excused),
        missing=tuple(sorted(missing)),
        **counts,
    )


def _position(body: bytes) -> Position:
    """Where a message of the spool belongs, sealed or not."""
    return SealedMessage.decode(body).position if is_sealed(body) else read_position(load(body))


def _lost(node: str, connection: Connection) -> Sightings:
    """What gaps state as lost."""
    lost = Sightings()
    e, gaps = events.c, events.alias()
    # Of statements, the first row holds the message, whatever it is about.
    gap = gaps.c
    here = and_(of_same_node(gaps, events), gap.boot == e.boot, gap.sequence == e.sequence)
    query = select(e.boot, e.sequence, e.data).where(
        of_node(events, node), e.data.is_not(None), exists().where(here, gap.kind == "gap")
    )
    for boot, sequence, data in connection.execute(query).all():
        if find_digest(connection, node, boot, sequence) != digest(bytes(data)):
            report_damaged("events", DamagedRow(node, boot, sequence))
            continue
        for each in _gaps(bytes(data)):
            for span in each.lost:
                lost.span(*span)
    return lost


def _gaps(data: bytes) -> Sequence[Gap]:
    """The gaps that a message states."""
    fields = load(data)
    if fields.integer(1, 0, 255) != Kind.STATEMENTS:
        return ()
    return Statements.read(fields).gaps


def _sighted(node: str, connection: Connection) -> Sightings:
    """What the cloud ever acknowledged, whether it still has it or not."""
    sighted = Sightings()
    query = select(sequences.c.boot, sequences.c.first, sequences.c.last)
    for span in connection.execute(query.where(of_node(sequences, node))):
        sighted.span(*span)
    return sighted


def _in_flash(layout: DemoFolder, query: str) -> Iterator[tuple[str, int, int]]:
    """Query the flash of nodes and fleets; gives the node, a boot and a sequence."""
    for path in layout.flashes:
        yield from _rows(path, query)


def _rows(path: Path, query: str) -> list[tuple[Any, ...]]:
    if not path.exists():
        return []
    try:
        with closing(sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro", uri=True)) as db:
            return db.execute(query).fetchall()
    except sqlite3.Error as error:
        raise AuditError(f"{path}: cannot be read: {error}") from error
