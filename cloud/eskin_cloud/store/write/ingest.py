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
from eskin.wire.frames import DescribedLayout, EncodedFrame, Privacy, Statements
from eskin.wire.messages import Position, Result, Status
from eskin.wire.slot import key_of, slot_of
from eskin_cloud.store.db_errors import explain, is_store_fault
from eskin_cloud.store.descriptions import (
    UnknownDescriptionError,
    find_refusal,
)
from eskin_cloud.store.feed_entry import FeedEntry
from eskin_cloud.store.frame_row import FrameRow, fit_frame
from eskin_cloud.store.schema.frame_tables import frames
from eskin_cloud.store.schema.node_key import of_node
from eskin_cloud.store.schema.sealed_tables import find_erased, sealed_messages
from eskin_cloud.store.schema.tables import dead_letters, events
from eskin_cloud.store.write.bulk_insert import bulk_insert
from eskin_cloud.store.write.commands import store_result
from eskin_cloud.store.write.duplicates import MAX_RANGES
from eskin_cloud.store.write.events import event_row, statement_rows, status_row, store_verdicts
from eskin_cloud.store.write.layouts import accept_layouts
from eskin_cloud.store.write.missing_messages import (
    describe_flash_rollback,
    record_boot_ends,
    record_lost,
)
from eskin_cloud.store.write.pages import (
    add_frames,
    add_sealed_frame,
    ensure_page,
    page_key,
)
from eskin_cloud.store.write.parsed_message import UNSEALED, WITHHELD, ParsedMessage, is_node
from eskin_cloud.store.write.presence import (
    mark_online,
    record_lag,
    record_layout,
    record_sealed_lag,
)
from eskin_cloud.store.write.removal_counts import RemovalReason, Sweep, record_removal

if TYPE_CHECKING:
    from collections.abc import Sequence
    from collections.abc import Set as AbstractSet

    from sqlalchemy import Connection

    from eskin_cloud.store.descriptions import DescriptionKey, LayoutResult
    from eskin_cloud.store.write.write_cache import Key, Row, WriteCache

log = logging.getLogger(__name__)

STORED: Final = "stored"
DUPLICATE: Final = "duplicate"
REJECTED: Final = "rejected"
UNKNOWN_NODE: Final = "unknown_node"
UNKNOWN_LAYOUT: Final = "unknown_layout"
LATER: Final = "later"
MOST_WANTED: Final = 256
"""Descriptions that one answer asks for."""


class Receipt(NamedTuple):
    """The result of one message.

    Attributes:
        result: ``stored``, ``duplicate``, ``rejected``, or ``unknown_node``: the cloud stores
            nothing of the node until the gateway presents its certificate for the gateway's site;
            or ``unknown_layout``: the same until it presents descriptions; or ``later``: it cannot
            be stored now, while messages of nodes in other slots can.
        reason: Why the message is not stored.
        want: Hashes of the descriptions, at most `MOST_WANTED`.
    """

    result: str
    reason: str | None = None
    want: tuple[bytes, ...] = ()


_Placed: TypeAlias = EncodedFrame | Statements | SealedMessage
"""What is read by a layout."""
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
        lag: Enclosure of the time from the last sample of the latest frame to its storage, ns.
        conflicts: Number of messages that differ from those stored under their numbers.
    """

    results: list[Receipt]
    entries: list[FeedEntry]
    dropped: int
    lag: tuple[int, int] | None = None
    conflicts: int = 0


@dataclass(slots=True)
class _Batch:
    connection: Connection
    cache: WriteCache
    now: int
    frames: list[FrameRow] = field(default_factory=list)
    layouts: dict[DescriptionKey, LayoutResult] = field(default_factory=dict)
    erased: AbstractSet[str] = frozenset()
    events: list[Row] = field(default_factory=list)
    sealed: list[Row] = field(default_factory=list)
    dead: list[Row] = field(default_factory=list)
    refused: list[tuple[str, Position]] = field(default_factory=list)
    entries: list[FeedEntry] = field(default_factory=list)
    conflicts: int = 0
    items: Sequence[ParsedMessage] = ()
    compared: bool = False
    foreign: AbstractSet[str] = frozenset()

    def add_event(self, row: Row | None) -> None:
        if row is None:
            return
        cursor = self.cache.next_cursor(row["node"])
        row |= {"cursor": cursor, "received": self.now}
        self.events.append(row)
        self.entries.append(FeedEntry(cursor, row["node"], row["channel"], row, self.now))


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
    batch = _Batch(connection, cache, now, items=items)
    if site is not None:
        nodes = {item.node for item in items}
        known = cache.sites(connection, nodes)
        batch.foreign = {node for node in nodes if known.get(node) != site and is_node(node)}
        # Asked for in this transaction: an erasure is committed before it, or after it.
        sealed = (item.message for item in items if isinstance(item.message, SealedMessage))
        subjects = {message.subject for message in sealed}
        batch.erased = find_erased(connection, site, subjects) if subjects else frozenset()
    _prepare(batch, [item for item in items if item.node not in batch.foreign])
    results = [_ingest_message(batch, item, gateway) for item in items]
    lag = _finish_frames(batch)
    if batch.events:
        connection.execute(insert(events), batch.events)
    if batch.sealed:
        connection.execute(insert(sealed_messages), batch.sealed)
    for node, (boot, sequence) in batch.refused:
        record_lost(connection, node, [(boot, sequence, sequence)])
    dropped = store_dead_letters(connection, batch.dead, most=dead_letters) if batch.dead else 0
    return IngestResult(results, batch.entries, dropped, lag, batch.conflicts)


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
            reason = f"it cannot be stored: {_reason_of(error)}"
            # What failed may have been to find out whether its layout is biometric.
            return take(ParsedMessage.unreadable(item.node, item.data, reason))
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
    boots: dict[tuple[str, int], None] = {}
    of_pages: dict[Key, None] = {}
    of_layouts: dict[DescriptionKey, None] = {}
    for item in items:
        node, message = item.node, item.message
        if message is None:
            continue
        boots[node, message.position.boot] = None
        if not isinstance(message, Status | Result) and message.layout is not None:
            of_layouts[node, message.layout] = None
        if isinstance(message, EncodedFrame):
            of_pages[*key_of(node), message.layout, message.page] = None
        elif isinstance(message, Statements):
            of_pages[*key_of(node), message.layout, 0] = None
        elif isinstance(message, SealedMessage) and isinstance(message.place, tuple):
            of_pages[*key_of(node), *message.place] = None
    batch.cache.prepare(batch.connection, boots=boots, of_pages=of_pages)
    batch.layouts = accept_layouts(batch.connection, batch.cache, of_layouts)


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
    if message is None:
        return _reject(batch, item, item.reason or "no message", gateway)
    if isinstance(message, Status | Result):
        return _ingest_report(batch, item, message, gateway)
    return _ingest_placed(batch, item, message, gateway)


def _ingest_report(
    batch: _Batch, item: ParsedMessage, message: Status | Result, gateway: str
) -> Receipt:
    """Store a status or the result of a command."""
    node, place = item.node, message.position
    ranges = batch.cache.ranges(batch.connection, node, place.boot)
    if place.sequence in ranges:
        return _check_duplicate(batch, item, place, gateway)
    if not ranges.has_room_for(place.sequence):
        return _reject(batch, item, _TOO_MANY_RANGES, gateway)
    batch.add_event(mark_online(batch.connection, batch.cache, node, place, now=batch.now))
    if isinstance(message, Result):
        batch.add_event(store_result(batch.connection, node, message, item.data))
    else:
        _store_status(batch, node, message, item.data)
    batch.cache.add(batch.connection, node, place.boot, place.sequence, item.digest)
    return _STORED


def _ingest_placed(batch: _Batch, item: ParsedMessage, message: _Placed, gateway: str) -> Receipt:
    """Store a frame or statements; `_finish_frames` does what frames share."""
    node, place, layout = item.node, message.position, message.layout
    assert layout is not None  # noqa: S101 - `ParsedMessage.parse` refuses others
    described = batch.layouts[node, layout]
    if isinstance(described, UnknownDescriptionError):
        return _ask_for_descriptions(batch, item, place, described, gateway)
    data = item.data
    if isinstance(described, MessageError) or described.biometric_pages:
        # A dead letter of it keeps no data, as they may be biometric.
        item = item._replace(data=b"")
    ranges = batch.cache.ranges(batch.connection, node, place.boot)
    if place.sequence in ranges:
        return _check_duplicate(batch, item, place, gateway)
    if not ranges.has_room_for(place.sequence):
        return _reject(batch, item, _TOO_MANY_RANGES, gateway)
    try:
        if isinstance(described, MessageError):
            raise described
        if isinstance(message, SealedMessage):
            _store_sealed_by_layout(batch, node, message, described, data)
        elif isinstance(message, EncodedFrame):
            _store_frame(batch, item, message, described)
        else:
            _store_statements(batch, item._replace(data=data), message, described)
    except MessageError as error:
        batch.refused.append((node, place))
        return _reject(batch, item, str(error), gateway)
    batch.cache.add(batch.connection, node, place.boot, place.sequence, item.digest)
    return _STORED


def _ask_for_descriptions(
    batch: _Batch,
    item: ParsedMessage,
    place: Position,
    unknown: UnknownDescriptionError,
    gateway: str,
) -> Receipt:
    """Ask for what a message is read by; reject the message where that is refused."""
    reason = find_refusal(item.node, unknown.want)
    if reason is None:
        return Receipt(UNKNOWN_LAYOUT, str(unknown), unknown.want[:MOST_WANTED])
    batch.refused.append((item.node, place))
    # What the message holds is not known, so it may be biometric.
    reason = f"a description is refused: {reason}{WITHHELD.format(len(item.data))}"
    return _reject(batch, item._replace(data=b""), reason, gateway)


def _store_frame(
    batch: _Batch, item: ParsedMessage, frame: EncodedFrame, described: DescribedLayout
) -> None:
    """Store a frame.

    Raises:
        MessageError: It does not fit its layout; nothing is stored.
    """
    fitting = fit_frame(frame, described)
    if frame.page in described.biometric_pages:
        raise MessageError(UNSEALED)
    _record_layout(batch, item.node, frame.position, frame.layout)
    cursor = batch.cache.next_cursor(item.node)
    row = FrameRow.of(*(item.node, frame, fitting, item.digest), cursor=cursor, now=batch.now)
    batch.frames.append(row)
    head = cursor, item.node, None, None, batch.now
    batch.entries.append(FeedEntry(*head, frame=frame.data, layout=frame.layout))


def _store_statements(
    batch: _Batch, item: ParsedMessage, statements: Statements, described: DescribedLayout
) -> None:
    """Store statements.

    Raises:
        MessageError: They do not fit their layout; nothing is stored.
    """
    if described.require_statements(statements) is Privacy.BIOMETRIC:
        raise MessageError(UNSEALED)
    # So retention finds the layout, also if the node has sent no frame.
    ensure_page(batch.connection, batch.cache, (*key_of(item.node), statements.layout, 0))
    _record_layout(batch, item.node, statements.position, statements.layout)
    rows = list(statement_rows(item.node, statements, described, item.data))
    for row in rows:
        batch.add_event(row)
    store_verdicts(batch.connection, [row for row in rows if row["kind"] == "verdict"])
    for gap in statements.gaps:
        record_lost(batch.connection, item.node, gap.lost)


def _store_sealed_by_layout(
    batch: _Batch, node: str, message: SealedMessage, described: DescribedLayout, data: bytes
) -> None:
    """Store a sealed frame, or sealed statements; of an erased subject, only their number.

    Raises:
        MessageError: Nothing of its page or layout is biometric; nothing is stored.
    """
    here = *key_of(node), described.hash
    page = message.place[1] if isinstance(message.place, tuple) else None
    if page is not None and page not in described.biometric_pages:
        raise MessageError(f"page {page} of the layout is not biometric; do not seal it")
    if not described.biometric_pages:
        raise MessageError("no page of the layout is biometric; do not seal statements of it")
    _record_layout(batch, node, message.position, described.hash)
    if message.subject in batch.erased:
        erased = Sweep(node, message.place_name, RemovalReason.ERASURE, message.time[1])
        record_removal(batch.connection, erased, 1, batch.now)
        return
    if page is not None:
        add_sealed_frame(batch.connection, batch.cache, (*here, page), message.time)
    else:
        # So retention finds the layout, also if the node has sent no frame.
        ensure_page(batch.connection, batch.cache, (*here, described.biometric_pages[0]))
    _add_sealed(batch, node, message, data)


def _add_sealed(batch: _Batch, node: str, message: SealedMessage, data: bytes) -> None:
    cursor = batch.cache.next_cursor(node)
    batch.sealed.append(_sealed_row(node, message, data, cursor, batch.now))
    head = cursor, node, None, None, batch.now, data
    batch.entries.append(FeedEntry(*head, layout=message.layout))
    record_sealed_lag(batch.connection, batch.cache, node, message, now=batch.now)


def _record_layout(batch: _Batch, node: str, place: Position, layout: bytes) -> None:
    batch.add_event(mark_online(batch.connection, batch.cache, node, place, now=batch.now))
    record_layout(batch.connection, batch.cache, node, place, layout)


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
    return isinstance(item.message, SealedMessage) and item.message.subject in batch.erased


def _reject(batch: _Batch, item: ParsedMessage, reason: str, gateway: str) -> Receipt:
    batch.dead.append(_dead_letter(item, reason, gateway, batch.now))
    return Receipt(REJECTED, reason)


def _store_status(batch: _Batch, node: str, status: Status, data: bytes) -> None:
    started = status_row(batch.connection, batch.cache, node, status, data, now=batch.now)
    batch.add_event(started)
    if started is not None and status.ended is not None:
        _check_flash(batch, node, status, status.ended)


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
        "place": message.place_name,
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
    """Store dead letters, the same bytes of a node once.

    As many of the oldest of the same slots are deleted as the store has above ``most``.

    Returns:
        The number of deleted ones.
    """
    d, key = dead_letters.c, tuple_(*dead_letters.primary_key.columns)
    for letter in letters:
        here = of_node(dead_letters, letter["node"]) & (d.digest == letter["digest"])
        if connection.execute(select(d.node).where(here)).first() is None:
            connection.execute(insert(dead_letters), letter)
    excess = count_dead_letters(connection) - most
    if excess <= 0:
        return 0
    # The transaction has locked no other slots.
    oldest = select(*dead_letters.primary_key.columns).where(
        d.slot.in_({slot_of(letter["node"]) for letter in letters})
    )
    oldest = oldest.order_by(d.received, d.digest).limit(excess)
    return connection.execute(delete(dead_letters).where(key.in_(oldest))).rowcount


def count_dead_letters(connection: Connection) -> int:
    """The number of dead letters."""
    return connection.execute(select(func.count()).select_from(dead_letters)).scalar_one()
