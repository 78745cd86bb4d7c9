"""Taking a batch into the store: each message once, whatever else is in the batch."""

from __future__ import annotations

import hashlib
import logging
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final, NamedTuple, TypeAlias

from sqlalchemy import insert, select

from eskin.privacy import SealedMessage
from eskin.wire.messages import BlockSummary, Gap, Peak, Position, Result, Status
from eskin_cloud.store.feed_entry import FeedEntry
from eskin_cloud.store.schema.sealed_tables import erased_subjects, veiled
from eskin_cloud.store.schema.tables import blocks, events
from eskin_cloud.store.write.block_row import BlockRow
from eskin_cloud.store.write.block_run import BlockRun
from eskin_cloud.store.write.bulk_insert import Inserts, inserts
from eskin_cloud.store.write.channels import add_veiled, check_channels, declare, named
from eskin_cloud.store.write.commands import keep_result
from eskin_cloud.store.write.dead_letters import keep
from eskin_cloud.store.write.events import event_row, gap_row, peak_row, status_row
from eskin_cloud.store.write.missing_messages import note_ends, note_lost, state_flash_age
from eskin_cloud.store.write.parsed_message import is_node
from eskin_cloud.store.write.presence import note_veiled_lag, see
from eskin_cloud.store.write.stored_sequences import MOST_RANGES

if TYPE_CHECKING:
    from collections.abc import Sequence
    from collections.abc import Set as AbstractSet

    from sqlalchemy import Connection

    from eskin_cloud.store.write.parsed_message import ParsedMessage
    from eskin_cloud.store.write.write_cache import Row, WriteCache

log = logging.getLogger(__name__)

STORED: Final = "stored"
DUPLICATE: Final = "duplicate"
REJECTED: Final = "rejected"
UNKNOWN_NODE: Final = "unknown_node"


class Receipt(NamedTuple):
    """What became of one item.

    Attributes:
        result: ``stored``, ``duplicate``, ``rejected``, or ``unknown_node``: nothing is kept of it
            until the gateway presents a certificate of that node for its own site.
        reason: Why it was rejected, or is not kept.
    """

    result: str
    reason: str | None = None


_Other: TypeAlias = Peak | Gap | Status | Result | SealedMessage
"""Whatever is no block."""
_KEPT: Final = Receipt(STORED)
_AGAIN: Final = Receipt(DUPLICATE)
_UNKNOWN: Final = Receipt(
    UNKNOWN_NODE, "no certificate of this node was presented for the gateway's site; present it"
)
CONFLICT: Final = (
    "another message is stored under its boot and sequence; see whether a node was copied or set "
    "back, or who else speaks for it"
)
_HOLES: Final = (
    f"its boot has {MOST_RANGES} holes between its sequence numbers; let the node start anew, and "
    "see why it leaves numbers out"
)


@dataclass(frozen=True, slots=True)
class IngestResult:
    """What became of a batch.

    Attributes:
        results: In the batch's order.
        entries: News for the live feed.
        buried: Dead letters that had to make room.
        lag: How long after its last sample the latest block was stored: an enclosure, ns.
        conflicts: Messages that differ from those stored under their numbers.
    """

    results: list[Receipt]
    entries: list[FeedEntry]
    buried: int
    lag: tuple[int, int] | None = None
    conflicts: int = 0


@dataclass(slots=True)
class _Batch:
    connection: Connection
    cache: WriteCache
    now: int
    blocks: Inserts
    events: list[Row] = field(default_factory=list)
    veiled: list[Row] = field(default_factory=list)
    dead: list[Row] = field(default_factory=list)
    refused: list[tuple[str, Position]] = field(default_factory=list)
    entries: list[FeedEntry] = field(default_factory=list)
    runs: dict[tuple[str, int, str], BlockRun] = field(default_factory=dict)
    conflicts: int = 0
    items: Sequence[ParsedMessage] = ()
    compared: bool = False
    site: str | None = None
    foreign: AbstractSet[str] = frozenset()

    def tell(self, row: Row) -> None:
        cursor = self.cache.next_cursor(self.connection)
        row |= {"cursor": cursor, "received": self.now}
        self.events.append(row)
        self.entries.append(FeedEntry(cursor, row["node"], row["channel"], None, row, self.now))


def ingest(
    connection: Connection,
    cache: WriteCache,
    items: Sequence[ParsedMessage],
    *,
    gateway: str,
    site: str | None = None,
    now: int,
    dead_letters: int,
) -> IngestResult:
    """Store a batch within a transaction; what the cache learns is to be saved before its end.

    Args:
        connection: The writing thread's, in a transaction.
        cache: The writing thread's.
        items: What a gateway brought.
        gateway: Its name, for dead letters.
        site: Its site; items of nodes that are not known to be of it are answered `UNKNOWN_NODE`.
            ``None`` takes all, where the caller knows whose they are.
        now: UTC ns.
        dead_letters: How many dead letters are kept.
    """
    batch = _Batch(connection, cache, now, inserts(connection, blocks), items=items, site=site)
    if site is not None:
        named = dict.fromkeys(item.node for item in items)
        known = cache.sites(connection, named)
        batch.foreign = {node for node in named if known.get(node) != site and is_node(node)}
    _prepare(batch, [item for item in items if item.node not in batch.foreign])
    results = [_take(batch, item, gateway) for item in items]
    lag = _settle(batch)
    batch.blocks.finish()
    if batch.events:
        connection.execute(insert(events), batch.events)
    if batch.veiled:
        connection.execute(insert(veiled), batch.veiled)
    for node, (boot, sequence) in batch.refused:
        note_lost(connection, node, [(boot, sequence, sequence)])
    buried = keep(connection, batch.dead, most=dead_letters) if batch.dead else 0
    return IngestResult(results, batch.entries, buried, lag, batch.conflicts)


def _prepare(batch: _Batch, items: Sequence[ParsedMessage]) -> None:
    runs: dict[tuple[str, int, str], None] = {}
    boots: dict[tuple[str, int], None] = {}
    places: dict[tuple[str, str], None] = {}
    for item in items:
        node, message = item.node, item.message
        if isinstance(message, BlockSummary):
            runs[node, message.position.boot, message.channel] = None
        elif message is not None:
            boots[node, message.position.boot] = None
            places |= dict.fromkeys((node, channel) for channel, _ in named(message))
    boots |= dict.fromkeys((node, boot) for node, boot, _ in runs)
    places |= dict.fromkeys((node, channel) for node, _, channel in runs)
    batch.cache.prepare(batch.connection, boots=boots, places=places)


def _settle(batch: _Batch) -> tuple[int, int] | None:
    """Add each run's blocks to what is known of its node and channel; gives the last's lag."""
    begun = [run for run in batch.runs.values() if run.rows]
    lag = None
    for run in sorted(begun, key=BlockRun.cursor):
        lag = run.settle(batch.connection, batch.cache, now=batch.now)
    return lag


def _take(batch: _Batch, item: ParsedMessage, gateway: str) -> Receipt:
    message, reason = item.message, item.reason
    if item.node in batch.foreign:
        return _UNKNOWN
    if isinstance(message, BlockSummary):
        return _take_block(batch, item, message, gateway)
    if message is not None:
        place = message.position
        ranges = batch.cache.ranges(batch.connection, item.node, place.boot)
        if place.sequence in ranges:
            return _compare(batch, item, place, gateway)
        if not ranges.has_room_for(place.sequence):
            return _refuse(batch, item, _HOLES, gateway)
        reason = check_channels(batch.connection, batch.cache, item.node, message)
    if message is None or reason is not None:
        if message is not None:
            batch.refused.append((item.node, message.position))
        return _refuse(batch, item, reason or "no message", gateway)
    _see(batch, item.node, message.position)
    _store(batch, item.node, message, item.data)
    batch.cache.add(batch.connection, item.node, place.boot, place.sequence, item.digest)
    return _KEPT


def _take_block(batch: _Batch, item: ParsedMessage, block: BlockSummary, gateway: str) -> Receipt:
    """Take a block in; what its run shares waits for `_settle`, as most items are blocks."""
    node, (boot, sequence) = item.node, block.position
    run = batch.runs.get((node, boot, block.channel))
    if run is None:
        ranges = batch.cache.ranges(batch.connection, node, boot)
        digests = batch.cache.digests.added(node, boot)
        run = BlockRun(node, boot, block.channel, ranges, digests)
        batch.runs[node, boot, block.channel] = run
    if sequence in run.ranges:
        return _compare(batch, item, block.position, gateway)
    if not run.ranges.has_room_for(sequence):
        return _refuse(batch, item, _HOLES, gateway)
    if block.unit != run.unit:
        reason = check_channels(batch.connection, batch.cache, node, block)
        if reason is not None:
            batch.refused.append((node, block.position))
            return _refuse(batch, item, reason, gateway)
    if not run.rows:
        _see(batch, node, block.position)
        run.begin(batch.connection, batch.cache, block)
    cursor = batch.cache.next_cursor(batch.connection)
    row = BlockRow.of(node, block, item.kept or item.data, item.digest, cursor, batch.now)
    run.rows.append(row)
    run.ranges.add(sequence)
    run.digests[sequence] = item.digest
    batch.blocks.add(row)
    batch.entries.append(FeedEntry(cursor, node, block.channel, item.data, None, batch.now))
    return _KEPT


def _compare(batch: _Batch, item: ParsedMessage, position: Position, gateway: str) -> Receipt:
    """Tell a message that comes again from another one under its number, which is a dead letter."""
    boot, sequence = position
    if not batch.compared:  # what comes again seldom comes alone
        batch.compared = True
        batch.cache.digests.fetch(batch.connection, _spans(batch.items))
    stored = batch.cache.digests.find(batch.connection, item.node, boot, sequence)
    if stored == item.digest or _is_of_erased(batch, item):
        return _AGAIN
    batch.conflicts += 1
    log.error(
        "message differs from the one stored: node=%s boot=%d sequence=%d gateway=%s",
        *(item.node, boot, sequence, gateway),
        extra={"source": item.node},
    )
    detail = f"boot {boot}, sequence {sequence}: differs from what is stored; from {gateway}"
    now = batch.now, batch.now
    batch.tell(event_row(item.node, "conflict", position, now, detail=detail))
    return _refuse(batch, item, CONFLICT, gateway)


def _spans(items: Sequence[ParsedMessage]) -> dict[tuple[str, int], tuple[int, int]]:
    """The least and the greatest number of each boot in a batch."""
    spans: dict[tuple[str, int], tuple[int, int]] = {}
    for item in items:
        if item.message is not None:
            boot, sequence = item.message.position
            least, most = spans.get((item.node, boot), (sequence, sequence))
            spans[item.node, boot] = min(least, sequence), max(most, sequence)
    return spans


def _is_of_erased(batch: _Batch, item: ParsedMessage) -> bool:
    """Whether a message is of an erased subject: each sealing of it has a key that nobody keeps."""
    if not isinstance(item.message, SealedMessage):
        return False
    e = erased_subjects.c
    gone = select(e.subject).where(e.subject == item.message.subject, e.site == batch.site)
    return batch.connection.execute(gone).first() is not None


def _refuse(batch: _Batch, item: ParsedMessage, reason: str, gateway: str) -> Receipt:
    batch.dead.append(_letter(item, reason, gateway, batch.now))
    return Receipt(REJECTED, reason)


def _see(batch: _Batch, node: str, position: Position) -> None:
    back = see(batch.connection, batch.cache, node, position, now=batch.now)
    if back is not None:
        batch.tell(back)


def _store(batch: _Batch, node: str, message: _Other, data: bytes) -> None:
    if isinstance(message, SealedMessage):
        cursor = batch.cache.next_cursor(batch.connection)
        batch.veiled.append(_veiled_row(node, message, data, cursor, batch.now))
        batch.entries.append(FeedEntry(cursor, node, message.channel, None, None, batch.now, data))
        add_veiled(batch.connection, batch.cache, node, message)
        note_veiled_lag(batch.connection, batch.cache, node, message, now=batch.now)
    elif isinstance(message, Peak):
        batch.tell(peak_row(node, message, data))
    elif isinstance(message, Gap):
        batch.tell(gap_row(node, message, data))
        note_lost(batch.connection, node, message.lost)
    elif isinstance(message, Result):
        _tell_if_any(batch, keep_result(batch.connection, node, message, data))
    else:
        declare(batch.connection, batch.cache, node, message)
        started = status_row(batch.connection, batch.cache, node, message, data, now=batch.now)
        _tell_if_any(batch, started)
        if started is not None and message.ended is not None:
            _compare_flash(batch, node, message, message.ended)


def _compare_flash(
    batch: _Batch, node: str, status: Status, ended: Sequence[tuple[int, int]]
) -> None:
    """At a node's start, hold what its flash knows of former boots against what is stored."""
    place = status.position
    former = [each for each in ended if each[0] < place.boot]
    note_ends(batch.connection, node, former)
    detail = state_flash_age(batch.connection, node, place.boot, former)
    if detail is not None:
        log.error("flash of a node is not the latest: node=%s detail=%r", node, detail)
        batch.tell(event_row(node, "status", place, status.time, detail=detail))


def _tell_if_any(batch: _Batch, row: Row | None) -> None:
    if row is not None:
        batch.tell(row)


def _veiled_row(node: str, message: SealedMessage, data: bytes, cursor: int, now: int) -> Row:
    return {
        "node": node,
        "boot": message.position.boot,
        "sequence": message.position.sequence,
        "cursor": cursor,
        "channel": message.channel,
        "kind": message.kind.name.lower(),
        "subject": message.subject,
        "t_lo": message.time[0],
        "t_hi": message.time[1],
        "received": now,
        "data": data,
    }


def _letter(item: ParsedMessage, reason: str, gateway: str, now: int) -> Row:
    return {
        "node": item.node,
        "digest": hashlib.sha256(item.data or reason.encode()).hexdigest(),
        "reason": reason,
        "gateway": gateway,
        "received": now,
        "data": item.data,
    }
