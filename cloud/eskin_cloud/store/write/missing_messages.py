"""Numbers that a node gave to messages which are stored nowhere here, and that no gap names.

A message that became a dead letter is not missing either.

A node counts its messages from 0 in each boot. So the ranges in `sequences` show what is missing
between them; what a node or a gateway says of a boot's end shows what is missing behind them.
Removal by age or erasure leaves `sequences` as they are: what was removed is not missing.
"""

from __future__ import annotations

import logging
import math
from collections import defaultdict
from typing import TYPE_CHECKING, Any, Final, NamedTuple, TypeAlias

from sqlalchemy import (
    BigInteger,
    Column,
    Integer,
    Table,
    and_,
    delete,
    exists,
    func,
    insert,
    literal_column,
    select,
    text,
    tuple_,
)

from eskin.errors import StoreError
from eskin.wire.messages import Position
from eskin_cloud.store.feed_entry import FeedEntry
from eskin_cloud.store.row_digests import keep_checked
from eskin_cloud.store.schema.tables import NODE_LENGTH, events, metadata, nodes, sequences
from eskin_cloud.store.schema.text_type import Text
from eskin_cloud.store.write.events import event_row

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from sqlalchemy import Connection, Select

    from eskin_cloud.store import Store
    from eskin_cloud.store.write.write_cache import WriteCache

log = logging.getLogger(__name__)

MOST_HOLES: Final = 1000
"""Of a node: beyond it, what is counted is a lower bound."""
_MOST_ASKED: Final = 4000
_MOST_NAMED: Final = 8
"""Ranges that an event names."""

Span: TypeAlias = tuple[int, int]
Boot: TypeAlias = tuple[str, int]

lost: Final = Table(
    "lost",
    metadata,
    Column("node", Text(NODE_LENGTH), primary_key=True),
    Column("boot", BigInteger, primary_key=True, autoincrement=False),
    Column("first", BigInteger, primary_key=True, autoincrement=False),
    Column("last", BigInteger, nullable=False),
)
"""Ranges of messages that gaps named as lost, or that became dead letters."""
keep_checked(lost)

ends: Final = Table(
    "ends",
    metadata,
    Column("node", Text(NODE_LENGTH), primary_key=True),
    Column("boot", BigInteger, primary_key=True, autoincrement=False),
    Column("last", BigInteger, nullable=False),
)
"""The greatest number of a boot that is known to have been given out, where it was stated."""
keep_checked(ends)

holes: Final = Table(
    "holes",
    metadata,
    Column("node", Text(NODE_LENGTH), primary_key=True),
    Column("boot", BigInteger, primary_key=True, autoincrement=False),
    Column("first", BigInteger, primary_key=True, autoincrement=False),
    Column("last", BigInteger, nullable=False),
    Column("since", BigInteger, nullable=False),
    Column("named", Integer, nullable=False),
)
"""What is missing: since when, UTC ns, and whether an event has named it."""
keep_checked(holes)

_LOSE: Final = text(
    "INSERT INTO lost (node, boot, first, last) VALUES (:node, :boot, :first, :last) "
    "ON CONFLICT (node, boot, first) DO UPDATE SET last = excluded.last "
    "WHERE excluded.last > lost.last"
)
_END: Final = text(
    "INSERT INTO ends (node, boot, last) VALUES (:node, :boot, :last) "
    "ON CONFLICT (node, boot) DO UPDATE SET last = excluded.last WHERE excluded.last > ends.last"
)


class MissingSpan(NamedTuple):
    """A range of missing messages.

    Attributes:
        boot: The node's boot.
        first: Its first number.
        last: Its last number.
        since: When it was first noticed, UTC ns.
        named: Whether an event has named it.
    """

    boot: int
    first: int
    last: int
    since: int
    named: bool

    @property
    def messages(self) -> int:
        """How many messages are missing."""
        return self.last - self.first + 1


def note_lost(connection: Connection, node: str, spans: Iterable[tuple[int, int, int]]) -> None:
    """Keep what a gap names, or what became a dead letter: ``(boot, first, last)``.

    A range that follows the one before it becomes a part of it.
    """
    o = lost.c
    for boot, first, last in spans:
        before = select(o.first, o.last).where(o.node == node, o.boot == boot, o.first <= first)
        row = connection.execute(before.order_by(o.first.desc()).limit(1)).first()
        begin = first if row is None or row.last < first - 1 else row.first
        connection.execute(_LOSE, {"node": node, "boot": boot, "first": begin, "last": last})


def note_ends(connection: Connection, node: str, stated: Iterable[tuple[int, int]]) -> None:
    """Keep the greatest number of each of some boots: ``(boot, last)``."""
    rows = [{"node": node, "boot": boot, "last": last} for boot, last in stated if last >= 0]
    if rows:
        connection.execute(_END, rows)


def find_missing(connection: Connection) -> dict[Boot, list[Span]]:
    """All that is missing now, by node and boot, in order.

    What a node still holds by its latest status is on its way, and not missing.
    """
    found: dict[Boot, list[Span]] = defaultdict(list)
    n = nodes.c
    held = {
        row.node: (row.held_boot, row.held_sequence)
        for row in connection.execute(
            select(n.node, n.held_boot, n.held_sequence).where(n.held_boot.is_not(None))
        )
    }
    count: dict[str, int] = defaultdict(int)
    for query in (_between(), _behind()):
        for node, boot, first, last in connection.execute(query):
            most = held.get(node, (math.inf, 0))
            if boot > most[0] or count[node] >= MOST_HOLES:
                continue
            end = min(last, most[1] - 1) if boot == most[0] else last
            if first <= end:
                found[node, boot].append((first, end))
                count[node] += 1
    for key, spans in _explained(connection, list(found)).items():
        found[key] = subtract(found[key], spans)
    return {key: spans for key, spans in found.items() if spans}


def _between() -> Select[Any]:
    s = sequences.c
    before = func.lag(s.last).over(partition_by=(s.node, s.boot), order_by=s.first)
    first = (func.coalesce(before, -1) + 1).label("begin")
    ranges = select(s.node, s.boot, first, (s.first - 1).label("finish")).subquery()
    r, o = ranges.c, lost.c
    # Most of what is explained is so by one range: that must not use up `MOST_HOLES`.
    same = (o.node == r.node) & (o.boot == r.boot) & (o.first == r.begin) & (o.last >= r.finish)
    missing = (r.begin <= r.finish) & ~exists().where(same)
    return select(r.node, r.boot, r.begin, r.finish).where(missing).order_by(*r)


def _behind() -> Select[Any]:
    s, e = sequences.c, ends.c
    stored = select(func.max(s.last)).where(and_(s.node == e.node, s.boot == e.boot))
    begin = func.coalesce(stored.scalar_subquery(), -1) + 1
    return select(e.node, e.boot, begin, e.last).where(e.last >= begin).order_by(e.node, e.boot)


def find_tails(
    connection: Connection, confirmed: Sequence[tuple[str, int, int]]
) -> list[tuple[str, int, int, int]]:
    """What lies behind the last stored number of a boot, up to where it is said to end.

    Args:
        connection: Of the store.
        confirmed: Node, boot, and the greatest number of it.

    Returns:
        Node, boot, first and last number, where something is missing.
    """
    s = sequences.c
    stored: dict[Boot, int] = {}
    keys = [(node, boot) for node, boot, _ in confirmed]
    query = select(s.node, s.boot, func.max(s.last)).group_by(s.node, s.boot)
    for begin in range(0, len(keys), _MOST_ASKED):
        here = tuple_(s.node, s.boot).in_(keys[begin : begin + _MOST_ASKED])
        for node, boot, last in connection.execute(query.where(here)):
            stored[node, boot] = last
    told = _explained(connection, keys)
    return [
        (node, boot, first, end)
        for node, boot, last in confirmed
        for first, end in subtract(
            [(stored.get((node, boot), -1) + 1, last)], told.get((node, boot), ())
        )
    ]


def _explained(connection: Connection, keys: Sequence[Boot]) -> dict[Boot, list[Span]]:
    told: dict[Boot, list[Span]] = defaultdict(list)
    o = lost.c
    for begin in range(0, len(keys), _MOST_ASKED):
        here = tuple_(o.node, o.boot).in_(keys[begin : begin + _MOST_ASKED])
        query = select(o.node, o.boot, o.first, o.last).where(here).order_by(o.first)
        for node, boot, first, last in connection.execute(query):
            told[node, boot].append((first, last))
    return told


def subtract(spans: Iterable[Span], others: Sequence[Span]) -> list[Span]:
    """What of some ranges lies in none of others, which are sorted by their first number."""
    left = []
    for first, last in spans:
        begin = first
        for low, high in others:
            if low > last:
                break
            if low > begin:
                left.append((begin, low - 1))
            begin = max(begin, high + 1)
        if begin <= last:
            left.append((begin, last))
    return left


def list_missing(connection: Connection, names: Sequence[str]) -> dict[str, list[MissingSpan]]:
    """What is missing of each of these nodes, in order."""
    h = holes.c
    found: dict[str, list[MissingSpan]] = defaultdict(list)
    query = select(holes).where(h.node.in_(names)).order_by(h.node, h.boot, h.first)
    for row in connection.execute(query):
        found[row.node].append(
            MissingSpan(row.boot, row.first, row.last, row.since, named=bool(row.named))
        )
    return found


def keep_missing(
    connection: Connection,
    cache: WriteCache,
    found: dict[Boot, list[Span]],
    *,
    patience: int,
    now: int,
) -> list[FeedEntry]:
    """Keep what is missing, and name what has been so for long, and what came after all.

    Args:
        connection: The writing thread's, in a transaction.
        cache: The writing thread's.
        found: As `find_missing` gives it.
        patience: After how many ns a hole is named.
        now: UTC ns.

    Returns:
        News for the live feed.
    """
    known: dict[Boot, list[MissingSpan]] = defaultdict(list)
    for row in connection.execute(select(holes).order_by(holes.c.first)):
        hole = MissingSpan(row.boot, row.first, row.last, row.since, named=bool(row.named))
        known[row.node, row.boot].append(hole)
    entries = []
    for key in sorted(known.keys() | found.keys()):
        old = known[key]
        new = [_grown(key[1], span, old, patience, now) for span in found.get(key, ())]
        if new == old:
            continue
        here = (holes.c.node == key[0]) & (holes.c.boot == key[1])
        connection.execute(delete(holes).where(here))
        if new:
            connection.execute(insert(holes), [{"node": key[0], **h._asdict()} for h in new])
        fresh = [h for h in new if h.named and not any(o.named and _meet(o, h) for o in old)]
        gone = [h for h in old if h.named and not any(_meet(h, other) for other in new)]
        for word, said, level in (("missing", fresh, log.error), ("found", gone, log.warning)):
            if said:
                detail = _told(word, key[1], said)
                level("messages %s: node=%s %s", word, key[0], detail)
                entries.append(_event(connection, cache, key, said, detail, now))
    return entries


def _grown(
    boot: int, span: Span, old: Iterable[MissingSpan], patience: int, now: int
) -> MissingSpan:
    met = [o for o in old if o.first <= span[1] and span[0] <= o.last]
    since = min([now, *(o.since for o in met)])
    return MissingSpan(
        boot, *span, since, named=any(o.named for o in met) or now - since >= patience
    )


def _meet(one: MissingSpan, other: MissingSpan) -> bool:
    return one.first <= other.last and other.first <= one.last


def _told(word: str, boot: int, said: Sequence[MissingSpan]) -> str:
    spans = ", ".join(f"{h.first} to {h.last}" for h in said[:_MOST_NAMED])
    rest = f" and {len(said) - _MOST_NAMED} more ranges" if len(said) > _MOST_NAMED else ""
    count = sum(h.messages for h in said)
    return f"{word}: {count} message{'s' * (count != 1)} of boot {boot}: {spans}{rest}"


def _event(
    connection: Connection,
    cache: WriteCache,
    key: Boot,
    said: Sequence[MissingSpan],
    detail: str,
    now: int,
) -> FeedEntry:
    position = Position(key[1], said[0].first)
    time = min(h.since for h in said), now
    row = event_row(key[0], "status", position, time, detail=detail)
    cursor = cache.next_cursor(connection)
    row |= {"cursor": cursor, "received": now}
    connection.execute(insert(events), row)
    return FeedEntry(cursor, key[0], None, None, row, now)


def count_missing(store: Store) -> float:
    """How many messages are missing, of all nodes, as events name them; NaN if it is unknown."""
    h = holes.c
    each = (h.last - h.first + 1) * literal_column("1.0")
    query = select(func.coalesce(func.sum(each), 0)).where(h.named == 1)
    try:
        with store.read() as connection:
            return float(connection.execute(query).scalar_one())
    except StoreError:
        return math.nan


def state_flash_age(
    connection: Connection, node: str, boot: int, stated: Sequence[tuple[int, int]]
) -> str | None:
    """Say that a node's flash was wiped, or replaced by an older copy of it, where that shows.

    Args:
        connection: Of the store.
        node: The node.
        boot: Its present boot.
        stated: ``(boot, last)`` of its former boots, as its flash knows them.

    Returns:
        What is wrong, for an event; ``None`` if nothing is.
    """
    s = sequences.c
    query = select(s.boot, s.last).where(s.node == node, s.boot < boot)
    row = connection.execute(query.order_by(s.boot.desc(), s.last.desc()).limit(1)).first()
    latest = max(stated, default=(-1, -1))
    if row is None or tuple(row) <= latest:
        return None
    knows = f"ends in boot {latest[0]} at {latest[1]}" if stated else "knows of no boot before"
    return (
        f"flash wiped or rolled back: it {knows}, but boot {row[0]} is stored up to {row[1]}; what "
        "waited in it is lost"
    )
