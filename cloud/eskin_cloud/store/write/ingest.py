"""Store a batch of messages, each exactly once."""

from __future__ import annotations

import hashlib
import logging
from dataclasses import dataclass, field
from itertools import chain
from typing import TYPE_CHECKING, Final, NamedTuple, TypeAlias

from sqlalchemy import delete, func, insert, select, tuple_
from sqlalchemy.exc import SQLAlchemyError

from eskin.errors import MessageError
from eskin.privacy import SealedMessage
from eskin.wire.frames import FrameSummary, Statements
from eskin.wire.messages import BlockSummary, Gap, Peak, Position, Result, Status
from eskin_cloud.store.db_errors import explain, is_store_fault
from eskin_cloud.store.descriptions import DescribedLayout, UnknownDescriptionError
from eskin_cloud.store.feed_entry import FeedEntry
from eskin_cloud.store.frame_row import FrameRow, find_span
from eskin_cloud.store.schema.frame_tables import frames
from eskin_cloud.store.schema.sealed_tables import erased_subjects, sealed_messages
from eskin_cloud.store.schema.tables import blocks, dead_letters, events
from eskin_cloud.store.slot import slot_of
from eskin_cloud.store.write.block_row import BlockRow
from eskin_cloud.store.write.bulk_insert import BulkInsert, bulk_insert
from eskin_cloud.store.write.channels import (
    add_blocks,
    add_sealed,
    channels_of,
    check_channels,
    declare_channels,
    ensure_channel,
)
from eskin_cloud.store.write.commands import store_result
from eskin_cloud.store.write.duplicates import MAX_RANGES
from eskin_cloud.store.write.events import event_row, gap_row, peak_row, status_row
from eskin_cloud.store.write.layouts import layout_of
from eskin_cloud.store.write.missing_messages import (
    describe_flash_rollback,
    record_boot_ends,
    record_lost,
)
from eskin_cloud.store.write.pages import add_frames, page_key
from eskin_cloud.store.write.parsed_message import ParsedMessage, is_node
from eskin_cloud.store.write.presence import (
    mark_online,
    record_lag,
    record_layout,
    record_position,
    record_sealed_lag,
)
from eskin_cloud.store.write.statements import require_patches, statement_rows

if TYPE_CHECKING:
    from collections.abc import Sequence
    from collections.abc import Set as AbstractSet

    from sqlalchemy import Connection

    from eskin_cloud.store.write.duplicates import StoredSequences
    from eskin_cloud.store.write.write_cache import Key, Row, WriteCache

log = logging.getLogger(__name__)

STORED: Final = "stored"
DUPLICATE: Final = "duplicate"
REJECTED: Final = "rejected"
UNKNOWN_NODE: Final = "unknown_node"
UNKNOWN_LAYOUT: Final = "unknown_layout"
MOST_WANTED: Final = 256
"""Descriptions that one answer asks for."""


class Receipt(NamedTuple):
    """The result of one message.

    Attributes:
        result: ``stored``, ``duplicate``, ``rejected``, or ``unknown_node``: the cloud stores
            nothing of the node until the gateway presents its certificate for the gateway's site;
            or ``unknown_layout``: the same until it presents descriptions.
        reason: Why the message is not stored.
        want: Hashes of the descriptions, at most `MOST_WANTED`.
    """

    result: str
    reason: str | None = None
    want: tuple[bytes, ...] = ()


_Placed: TypeAlias = FrameSummary | Statements
"""What is read by a layout."""
_NonBlock: TypeAlias = Peak | Gap | Status | Result | SealedMessage
_STORED: Final = Receipt(STORED)
_DUPLICATE: Final = Receipt(DUPLICATE)
_UNKNOWN: Final = Receipt(
    UNKNOWN_NODE, "no certificate of this node is known for the gateway's site; present it"
)
CONFLICT: Final = (
    "another message is stored under this boot and sequence; check whether the node was cloned or "
    "restored, or whether another party uses its key"
)
_TOO_MANY_RANGES: Final = (
    f"this boot has {MAX_RANGES} gaps between its sequence numbers; restart the node, and find out "
    "why it skips numbers"
)


@dataclass(frozen=True, slots=True)
class IngestResult:
    """The result of a batch.

    Attributes:
        results: One a message, in the batch's order.
        entries: Entries for the live feed.
        dropped: Number of old dead letters that were deleted to make room.
        lag: Enclosure of the time from the last sample of the latest block or frame to its
            storage, ns.
        conflicts: Number of messages that differ from those stored under their numbers.
    """

    results: list[Receipt]
    entries: list[FeedEntry]
    dropped: int
    lag: tuple[int, int] | None = None
    conflicts: int = 0


@dataclass(slots=True)
class _BlockRun:
    """A batch's blocks of one channel in one boot; work that they share is done once.

    Attributes:
        node: The node.
        boot: Its boot.
        channel: Its channel.
        ranges: The cache's stored sequence numbers of this boot.
        digests: The cache's new digests of this boot, by sequence number.
        known: The channel's row; empty before the first block.
        rows: The blocks' rows, in the batch's order.
    """

    node: str
    boot: int
    channel: str
    ranges: StoredSequences
    digests: dict[int, bytes]
    known: Row = field(default_factory=dict)
    rows: list[BlockRow] = field(default_factory=list)


@dataclass(slots=True)
class _Batch:
    connection: Connection
    cache: WriteCache
    now: int
    blocks: BulkInsert
    frames: list[FrameRow] = field(default_factory=list)
    layouts: dict[tuple[str, bytes], DescribedLayout | UnknownDescriptionError | MessageError] = (
        field(default_factory=dict)
    )
    events: list[Row] = field(default_factory=list)
    sealed: list[Row] = field(default_factory=list)
    dead: list[Row] = field(default_factory=list)
    refused: list[tuple[str, Position]] = field(default_factory=list)
    entries: list[FeedEntry] = field(default_factory=list)
    runs: dict[tuple[str, int, str], _BlockRun] = field(default_factory=dict)
    conflicts: int = 0
    items: Sequence[ParsedMessage] = ()
    compared: bool = False
    site: str | None = None
    foreign: AbstractSet[str] = frozenset()

    def add_event(self, row: Row | None) -> None:
        if row is None:
            return
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
    """Store a batch within a transaction; the caller saves the cache before the commit.

    Args:
        connection: The writer's, in a transaction.
        cache: The writer's.
        items: The batch.
        gateway: Name of the gateway that sent it.
        site: The gateway's site; messages of nodes that are not of it get `UNKNOWN_NODE`.
            ``None`` accepts all nodes.
        now: UTC ns.
        dead_letters: Most dead letters that are kept.
    """
    batch = _Batch(connection, cache, now, bulk_insert(connection, blocks), items=items, site=site)
    if site is not None:
        nodes = {item.node for item in items}
        known = cache.sites(connection, nodes)
        batch.foreign = {node for node in nodes if known.get(node) != site and is_node(node)}
    _prepare(batch, [item for item in items if item.node not in batch.foreign])
    results = [_ingest_message(batch, item, gateway) for item in items]
    lags = _finish_runs(batch), _finish_frames(batch)
    batch.blocks.finish()
    if batch.events:
        connection.execute(insert(events), batch.events)
    if batch.sealed:
        connection.execute(insert(sealed_messages), batch.sealed)
    for node, (boot, sequence) in batch.refused:
        record_lost(connection, node, [(boot, sequence, sequence)])
    dropped = store_dead_letters(connection, batch.dead, most=dead_letters) if batch.dead else 0
    return IngestResult(results, batch.entries, dropped, lags[1] or lags[0], batch.conflicts)


def ingest_individually(
    connection: Connection,
    cache: WriteCache,
    items: Sequence[ParsedMessage],
    *,
    gateway: str,
    site: str | None = None,
    now: int,
    dead_letters: int,
) -> IngestResult:
    """Store a batch, each message in a savepoint; one that fails becomes a dead letter.

    Otherwise the gateway would resend the same batch without end. Arguments and result are those
    of `ingest`.
    """

    def take(item: ParsedMessage) -> IngestResult:
        outcome = ingest(
            connection,
            cache,
            [item],
            gateway=gateway,
            site=site,
            now=now,
            dead_letters=dead_letters,
        )
        cache.save(connection)  # a later failure clears the cache
        return outcome

    def take_or_reject(item: ParsedMessage) -> IngestResult:
        savepoint = connection.begin_nested()
        try:
            outcome = take(item)
        except Exception as error:
            if is_store_fault(error):
                raise
            savepoint.rollback()
            cache.clear()
            log.exception("message failed: node=%s bytes=%d", item.node, len(item.data))
            if item.message is not None:
                boot, sequence = item.message.position
                record_lost(connection, item.node, [(boot, sequence, sequence)])
            return take(
                ParsedMessage.rejected(
                    item.node, item.data, f"it cannot be stored: {_reason_of(error)}"
                )
            )
        savepoint.commit()
        return outcome

    outcomes = [take_or_reject(item) for item in items]
    lags = [outcome.lag for outcome in outcomes if outcome.lag is not None]
    return IngestResult(
        results=list(chain.from_iterable(outcome.results for outcome in outcomes)),
        entries=list(chain.from_iterable(outcome.entries for outcome in outcomes)),
        dropped=sum(outcome.dropped for outcome in outcomes),
        lag=lags[-1] if lags else None,
        conflicts=sum(outcome.conflicts for outcome in outcomes),
    )


def _prepare(batch: _Batch, items: Sequence[ParsedMessage]) -> None:
    runs: dict[tuple[str, int, str], None] = {}
    boots: dict[tuple[str, int], None] = {}
    places: dict[tuple[str, str], None] = {}
    of_pages: dict[tuple[int, str, bytes, int], None] = {}
    for item in items:
        node, message = item.node, item.message
        if isinstance(message, BlockSummary):
            runs[node, message.position.boot, message.channel] = None
        elif isinstance(message, FrameSummary | Statements):
            boots[node, message.position.boot] = None
            if isinstance(message, FrameSummary):
                of_pages[slot_of(node), node, message.layout, message.page] = None
        elif message is not None:
            boots[node, message.position.boot] = None
            places |= dict.fromkeys((node, channel) for channel, _ in channels_of(message))
    boots |= dict.fromkeys((node, boot) for node, boot, _ in runs)
    places |= dict.fromkeys((node, channel) for node, _, channel in runs)
    batch.cache.prepare(batch.connection, boots=boots, places=places, of_pages=of_pages)


def _finish_runs(batch: _Batch) -> tuple[int, int] | None:
    """Add each run's blocks to the rows of node and channel; returns the last block's lag."""
    lag = None
    for run in sorted((r for r in batch.runs.values() if r.rows), key=lambda r: r.rows[-1].cursor):
        batch.cache.mark_ranges_changed(run.node, run.boot)
        add_blocks(batch.cache, run.known, run.rows)
        lag = record_position(batch.connection, batch.cache, run.rows, now=batch.now)
    return lag


def _finish_frames(batch: _Batch) -> tuple[int, int] | None:
    """Insert frames, add them to the rows of node and page; returns the last frame's lag."""
    lag = None
    of_pages: dict[Key, list[FrameRow]] = {}
    latest: dict[str, FrameRow] = {}
    inserted = bulk_insert(batch.connection, frames)
    for row in batch.frames:
        of_pages.setdefault(page_key(row), []).append(row)
        latest[row.node] = row
    for rows in of_pages.values():
        add_frames(batch.connection, batch.cache, rows)
    for row in sorted(latest.values(), key=lambda row: row.cursor):
        lag = record_lag(batch.connection, batch.cache, row.node, row.last_time, now=batch.now)
    for row in batch.frames:
        inserted.add(row)
    inserted.finish()
    return lag


def _ingest_message(batch: _Batch, item: ParsedMessage, gateway: str) -> Receipt:
    message = item.message
    if item.node in batch.foreign:
        return _UNKNOWN
    if isinstance(message, BlockSummary):
        return _ingest_block(batch, item, message, gateway)
    if isinstance(message, FrameSummary | Statements):
        return _ingest_placed(batch, item, message, gateway)
    return _ingest_other(batch, item, message, gateway)


def _ingest_other(
    batch: _Batch, item: ParsedMessage, message: _NonBlock | None, gateway: str
) -> Receipt:
    reason = item.reason
    if message is not None:
        place = message.position
        ranges = batch.cache.ranges(batch.connection, item.node, place.boot)
        if place.sequence in ranges:
            return _check_duplicate(batch, item, place, gateway)
        if not ranges.has_room_for(place.sequence):
            return _reject(batch, item, _TOO_MANY_RANGES, gateway)
        reason = check_channels(batch.connection, batch.cache, item.node, message)
    if message is None or reason is not None:
        if message is not None:
            batch.refused.append((item.node, message.position))
        return _reject(batch, item, reason or "no message", gateway)
    batch.add_event(
        mark_online(batch.connection, batch.cache, item.node, message.position, now=batch.now)
    )
    _store_message(batch, item.node, message, item.data)
    batch.cache.add(batch.connection, item.node, place.boot, place.sequence, item.digest)
    return _STORED


def _ingest_block(batch: _Batch, item: ParsedMessage, block: BlockSummary, gateway: str) -> Receipt:
    """Store a block; `_finish_runs` does what the blocks of a run share."""
    node, (boot, sequence) = item.node, block.position
    run = batch.runs.get((node, boot, block.channel))
    if run is None:
        ranges = batch.cache.ranges(batch.connection, node, boot)
        digests = batch.cache.digests.added(node, boot)
        run = _BlockRun(node, boot, block.channel, ranges, digests)
        batch.runs[node, boot, block.channel] = run
    if sequence in run.ranges:
        return _check_duplicate(batch, item, block.position, gateway)
    if not run.ranges.has_room_for(sequence):
        return _reject(batch, item, _TOO_MANY_RANGES, gateway)
    if block.unit != run.known.get("unit"):
        reason = check_channels(batch.connection, batch.cache, node, block)
        if reason is not None:
            batch.refused.append((node, block.position))
            return _reject(batch, item, reason, gateway)
    if not run.rows:
        batch.add_event(
            mark_online(batch.connection, batch.cache, node, block.position, now=batch.now)
        )
        # Before the first block is stored: a batch must not state two units of a new channel.
        run.known = ensure_channel(batch.connection, batch.cache, node, block)
    cursor = batch.cache.next_cursor(batch.connection)
    row = BlockRow.of(node, block, item.compressed or item.data, item.digest, cursor, batch.now)
    run.rows.append(row)
    run.ranges.add(sequence)
    run.digests[sequence] = item.digest
    batch.blocks.add(row)
    batch.entries.append(FeedEntry(cursor, node, block.channel, item.data, None, batch.now))
    return _STORED


def _ingest_placed(batch: _Batch, item: ParsedMessage, message: _Placed, gateway: str) -> Receipt:
    """Store a frame or statements; `_finish_frames` does what frames share."""
    node, place = item.node, message.position
    described = _find_layout(batch, node, message.layout)
    if isinstance(described, UnknownDescriptionError):
        return Receipt(UNKNOWN_LAYOUT, str(described), described.want[:MOST_WANTED])
    ranges = batch.cache.ranges(batch.connection, node, place.boot)
    if place.sequence in ranges:
        return _check_duplicate(batch, item, place, gateway)
    if not ranges.has_room_for(place.sequence):
        return _reject(batch, item, _TOO_MANY_RANGES, gateway)
    try:
        if isinstance(described, MessageError):
            raise described
        if isinstance(message, FrameSummary):
            described.require_frame(message)
            span = find_span(message, described, item.data)
        else:
            require_patches(message, described)
    except MessageError as error:
        batch.refused.append((node, place))
        return _reject(batch, item, str(error), gateway)
    batch.add_event(mark_online(batch.connection, batch.cache, node, place, now=batch.now))
    record_layout(batch.connection, batch.cache, node, place, message.layout)
    if isinstance(message, FrameSummary):
        cursor = batch.cache.next_cursor(batch.connection)
        batch.frames.append(
            FrameRow.of(
                *(node, message, span, item.data, item.digest), cursor=cursor, now=batch.now
            )
        )
        batch.entries.append(
            FeedEntry(
                *(cursor, node, None, None, None, batch.now),
                frame=item.data,
                layout=message.layout,
            )
        )
    else:
        for row in statement_rows(node, message, described, item.data):
            batch.add_event(row)
        for gap in message.gaps:
            record_lost(batch.connection, node, gap.lost)
    batch.cache.add(batch.connection, node, place.boot, place.sequence, item.digest)
    return _STORED


def _find_layout(
    batch: _Batch, node: str, name: bytes
) -> DescribedLayout | UnknownDescriptionError | MessageError:
    """A layout, or why there is none; looked for once a batch."""
    found = batch.layouts.get((node, name))
    if found is None:
        try:
            found = layout_of(batch.connection, batch.cache, node, name)
        except (UnknownDescriptionError, MessageError) as error:
            found = error
        batch.layouts[node, name] = found
    return found


def _check_duplicate(
    batch: _Batch, item: ParsedMessage, position: Position, gateway: str
) -> Receipt:
    """Accept a duplicate; reject another message under a stored number."""
    boot, sequence = position
    if not batch.compared:  # duplicates seldom come alone
        batch.compared = True
        batch.cache.digests.fetch(batch.connection, _spans(batch.items))
    stored = batch.cache.digests.find(batch.connection, item.node, boot, sequence)
    if stored == item.digest or _is_of_erased_subject(batch, item):
        return _DUPLICATE
    batch.conflicts += 1
    log.error(
        "message differs from the one stored: node=%s boot=%d sequence=%d gateway=%s",
        *(item.node, boot, sequence, gateway),
        extra={"source": item.node},
    )
    detail = f"boot {boot}, sequence {sequence}: differs from the stored message; from {gateway}"
    now = batch.now, batch.now
    batch.add_event(event_row(item.node, "conflict", position, now, detail=detail))
    return _reject(batch, item, CONFLICT, gateway)


def _spans(items: Sequence[ParsedMessage]) -> dict[tuple[str, int], tuple[int, int]]:
    """The least and the greatest sequence number of each boot in a batch."""
    spans: dict[tuple[str, int], tuple[int, int]] = {}
    for item in items:
        if item.message is not None:
            boot, sequence = item.message.position
            least, most = spans.get((item.node, boot), (sequence, sequence))
            spans[item.node, boot] = min(least, sequence), max(most, sequence)
    return spans


def _is_of_erased_subject(batch: _Batch, item: ParsedMessage) -> bool:
    """Whether a sealed message is of an erased subject, whose digest differs at each sealing."""
    if not isinstance(item.message, SealedMessage):
        return False
    e = erased_subjects.c
    gone = select(e.subject).where(e.subject == item.message.subject, e.site == batch.site)
    return batch.connection.execute(gone).first() is not None


def _reject(batch: _Batch, item: ParsedMessage, reason: str, gateway: str) -> Receipt:
    batch.dead.append(_dead_letter(item, reason, gateway, batch.now))
    return Receipt(REJECTED, reason)


def _store_message(batch: _Batch, node: str, message: _NonBlock, data: bytes) -> None:
    if isinstance(message, SealedMessage):
        cursor = batch.cache.next_cursor(batch.connection)
        batch.sealed.append(_sealed_row(node, message, data, cursor, batch.now))
        batch.entries.append(FeedEntry(cursor, node, message.channel, None, None, batch.now, data))
        add_sealed(batch.connection, batch.cache, node, message)
        record_sealed_lag(batch.connection, batch.cache, node, message, now=batch.now)
    elif isinstance(message, Peak):
        batch.add_event(peak_row(node, message, data))
    elif isinstance(message, Gap):
        batch.add_event(gap_row(node, message, data))
        record_lost(batch.connection, node, message.lost)
    elif isinstance(message, Result):
        batch.add_event(store_result(batch.connection, node, message, data))
    else:
        declare_channels(batch.connection, batch.cache, node, message)
        started = status_row(batch.connection, batch.cache, node, message, data, now=batch.now)
        batch.add_event(started)
        if started is not None and message.ended is not None:
            _check_flash(batch, node, message, message.ended)


def _check_flash(
    batch: _Batch, node: str, status: Status, ended: Sequence[tuple[int, int]]
) -> None:
    """At a node's start, compare what its flash states of former boots with the store."""
    place = status.position
    former = [each for each in ended if each[0] < place.boot]
    record_boot_ends(batch.connection, node, former)
    detail = describe_flash_rollback(batch.connection, node, place.boot, former)
    if detail is not None:
        log.error("flash rolled back: node=%s detail=%r", node, detail)
        batch.add_event(event_row(node, "status", place, status.time, detail=detail))


def _sealed_row(node: str, message: SealedMessage, data: bytes, cursor: int, now: int) -> Row:
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


def _dead_letter(item: ParsedMessage, reason: str, gateway: str, now: int) -> Row:
    return {
        "node": item.node,
        "digest": hashlib.sha256(item.data or reason.encode()).hexdigest(),
        "reason": reason,
        "gateway": gateway,
        "received": now,
        "data": item.data,
    }


def _reason_of(error: Exception) -> str:
    """The error without values that it may quote: a dead letter's reason is not confidential."""
    name = type(error).__name__
    return f"{name}: {explain(error)}" if isinstance(error, SQLAlchemyError) else name


def store_dead_letters(connection: Connection, letters: Sequence[Row], *, most: int) -> int:
    """Store dead letters, the same bytes of a node once, and delete the oldest above ``most``.

    Returns:
        The number of deleted ones.
    """
    key = tuple_(dead_letters.c.node, dead_letters.c.digest)
    for letter in letters:
        here = key == tuple_(letter["node"], letter["digest"])
        if connection.execute(select(dead_letters.c.node).where(here)).first() is None:
            connection.execute(insert(dead_letters), letter)
    excess = count_dead_letters(connection) - most
    if excess <= 0:
        return 0
    oldest = select(dead_letters.c.node, dead_letters.c.digest)
    oldest = oldest.order_by(dead_letters.c.received, dead_letters.c.digest).limit(excess)
    connection.execute(delete(dead_letters).where(key.in_(oldest)))
    return excess


def count_dead_letters(connection: Connection) -> int:
    """The number of dead letters."""
    return connection.execute(select(func.count()).select_from(dead_letters)).scalar_one()
