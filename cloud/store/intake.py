"""Taking a batch into the store: each message once, whatever else is in the batch."""

from __future__ import annotations

import functools
import hashlib
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final, NamedTuple

from sqlalchemy import insert

from cloud.store.bulk import insert_many
from cloud.store.channels import add_block, add_veiled, check_units, declare, units
from cloud.store.commands import keep_result
from cloud.store.dead_letters import bury
from cloud.store.entry import Entry
from cloud.store.events import gap_row, peak_row, status_row
from cloud.store.presence import note_lag, note_veiled_lag, see
from cloud.store.schema import NODE_LENGTH, blocks, events
from cloud.store.sealed import veiled
from eskin.errors import IdentityError, MessageError
from eskin.identity import IdentityKind
from eskin.messages import BlockSummary, Gap, Peak, Result, Summary, decode_summary
from eskin.messages.head import Kind
from eskin.privacy import Veiled, is_biometric, is_veiled

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sqlalchemy import Connection

    from cloud.store.ledger import Ledger, Row

STORED: Final = "stored"
DUPLICATE: Final = "duplicate"
REJECTED: Final = "rejected"

_MOST_MOMENT: Final = 2**63 - 1
IN_THE_CLEAR: Final = (
    "it tells of a person and is not sealed, so that none of it is kept here; let a gateway that "
    "seals bring it"
)


class Item(NamedTuple):
    """One message of a batch, already read.

    Attributes:
        node: Who said it, as the gateway vouches.
        data: Its bytes.
        message: What they say; ``None`` if they say nothing.
        reason: Why not.
    """

    node: str
    data: bytes
    message: Summary | Veiled | None
    reason: str | None = None

    @classmethod
    def read(cls, node: str, data: bytes) -> Item:
        """Read a message; a poor one becomes an item with a reason."""
        try:
            _require_node(node)
            if is_veiled(data):
                return cls(node, data, _require_biometric(Veiled.decode(data)))
            message = decode_summary(data)
            if isinstance(message, BlockSummary | Peak) and is_biometric(message.channel):
                return cls.refused(node, b"", IN_THE_CLEAR)
            _require_storable(message)
        except (MessageError, IdentityError) as error:
            return cls.refused(node, data, str(error))
        return cls(node, data, message)

    @classmethod
    def refused(cls, node: str, data: bytes, reason: str) -> Item:
        """An item that says nothing."""
        shown = "".join(letter for letter in node[:NODE_LENGTH] if letter.isprintable())
        return cls(shown, data, None, reason)


class Receipt(NamedTuple):
    """What became of one item.

    Attributes:
        result: ``stored``, ``duplicate`` or ``rejected``.
        reason: Why it was rejected.
    """

    result: str
    reason: str | None = None


_KEPT: Final = Receipt(STORED)
_AGAIN: Final = Receipt(DUPLICATE)


@dataclass(frozen=True, slots=True)
class Outcome:
    """What became of a batch.

    Attributes:
        results: In the batch's order.
        entries: News for the live feed.
        buried: Dead letters that had to make room.
        lag: How long after its last sample the latest block was stored: an enclosure, ns.
    """

    results: list[Receipt]
    entries: list[Entry]
    buried: int
    lag: tuple[int, int] | None = None


@dataclass(slots=True)
class _Batch:
    connection: Connection
    ledger: Ledger
    now: int
    blocks: list[Row] = field(default_factory=list)
    events: list[Row] = field(default_factory=list)
    veiled: list[Row] = field(default_factory=list)
    dead: list[Row] = field(default_factory=list)
    entries: list[Entry] = field(default_factory=list)
    lag: tuple[int, int] | None = None

    def tell(self, row: Row) -> None:
        cursor = self.ledger.next_cursor(self.connection)
        row |= {"cursor": cursor, "received": self.now}
        self.events.append(row)
        self.entries.append(Entry(cursor, row["node"], row["channel"], None, row))


def take_in(
    connection: Connection,
    ledger: Ledger,
    items: Sequence[Item],
    *,
    gateway: str,
    now: int,
    dead_letters: int,
) -> Outcome:
    """Store a batch within a transaction.

    Args:
        connection: The writing thread's, in a transaction.
        ledger: The writing thread's.
        items: What a gateway brought.
        gateway: Its name, for dead letters.
        now: UTC ns.
        dead_letters: How many dead letters are kept.
    """
    batch = _Batch(connection, ledger, now)
    said = [(item.node, item.message) for item in items if item.message is not None]
    ledger.prepare(
        connection,
        boots=[(node, message.position.boot) for node, message in said],
        places=[(node, place) for node, message in said for place, _ in units(message)],
    )
    results = [_take(batch, item, gateway) for item in items]
    if batch.blocks:
        insert_many(connection, blocks, batch.blocks)
    if batch.events:
        connection.execute(insert(events), batch.events)
    if batch.veiled:
        connection.execute(insert(veiled), batch.veiled)
    buried = bury(connection, batch.dead, most=dead_letters) if batch.dead else 0
    ledger.save(connection)
    return Outcome(results, batch.entries, buried, batch.lag)


def _take(batch: _Batch, item: Item, gateway: str) -> Receipt:
    message, reason = item.message, item.reason
    if message is not None:
        place = message.position
        if place.sequence in batch.ledger.ranges(batch.connection, item.node, place.boot):
            return _AGAIN
        reason = check_units(batch.connection, batch.ledger, item.node, message)
    if message is None or reason is not None:
        reason = reason or "no message"
        batch.dead.append(_letter(item, reason, gateway, batch.now))
        return Receipt(REJECTED, reason)
    _store(batch, item.node, message, item.data)
    batch.ledger.add(batch.connection, item.node, place.boot, place.sequence)
    return _KEPT


def _store(batch: _Batch, node: str, message: Summary | Veiled, data: bytes) -> None:
    back = see(batch.connection, batch.ledger, node, message.position, now=batch.now)
    if back is not None:
        batch.tell(back)
    if isinstance(message, BlockSummary):
        cursor = batch.ledger.next_cursor(batch.connection)
        batch.blocks.append(block_row(node, message, data, cursor, batch.now))
        batch.entries.append(Entry(cursor, node, message.channel, data, None))
        add_block(batch.connection, batch.ledger, node, message, len(data))
        batch.lag = note_lag(batch.connection, batch.ledger, node, message, now=batch.now)
    elif isinstance(message, Veiled):
        cursor = batch.ledger.next_cursor(batch.connection)
        batch.veiled.append(_veiled_row(node, message, data, cursor, batch.now))
        batch.entries.append(Entry(cursor, node, message.channel, None, None, data))
        add_veiled(batch.connection, batch.ledger, node, message)
        note_veiled_lag(batch.connection, batch.ledger, node, message, now=batch.now)
    elif isinstance(message, Peak):
        batch.tell(peak_row(node, message, data))
    elif isinstance(message, Gap):
        batch.tell(gap_row(node, message, data))
    elif isinstance(message, Result):
        _tell_if_any(batch, keep_result(batch.connection, node, message, data))
    else:
        declare(batch.connection, batch.ledger, node, message)
        _tell_if_any(batch, status_row(batch.connection, batch.ledger, node, message, data))


def _tell_if_any(batch: _Batch, row: Row | None) -> None:
    if row is not None:
        batch.tell(row)


def block_row(node: str, block: BlockSummary, data: bytes, cursor: int, now: int) -> Row:
    """A block's row in the store."""
    first = block.first_moment
    (t_lo, t_hi), (lo, hi) = block.time, block.bounds
    return {
        "node": node,
        "boot": block.position.boot,
        "sequence": block.position.sequence,
        "cursor": cursor,
        "channel": block.channel,
        "t": first,
        "t_end": first + block.span,
        "error": block.time_error,
        "t_lo": t_lo,
        "t_hi": t_hi,
        "dt": block.dt,
        "n": block.n,
        "lo": lo,
        "hi": hi,
        "coverage": block.coverage,
        "received": now,
        "data": data,
        "packed": None,
    }


def _veiled_row(node: str, message: Veiled, data: bytes, cursor: int, now: int) -> Row:
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


def _letter(item: Item, reason: str, gateway: str, now: int) -> Row:
    return {
        "node": item.node,
        "digest": hashlib.sha256(item.data).hexdigest(),
        "reason": reason,
        "gateway": gateway,
        "received": now,
        "data": item.data,
    }


@functools.lru_cache(4096)
def _require_node(name: str) -> None:
    IdentityKind.NODE.require_name(name)


def _require_biometric(message: Veiled) -> Veiled:
    if message.kind is Kind.VEILED or not is_biometric(message.channel):
        raise MessageError(f"channel {message.channel} is not biometric; it is not to be sealed")
    return message


def _require_storable(message: Summary) -> None:
    if isinstance(message, BlockSummary) and message.time[1] + message.span > _MOST_MOMENT:
        raise MessageError(
            f"last sample lies after the year 2262: first at {message.time[1]} ns, "
            f"{message.n} samples of {message.dt} ns"
        )
