"""Missing messages: sequence numbers that are neither stored, stated lost, nor dead letters.

A node numbers its messages from 0 in each boot. Gaps between the ranges of `sequences` are missing,
and so are numbers between the last range and a boot's stated end. Retention and erasure leave
`sequences` unchanged: removed messages are not missing.
"""

from __future__ import annotations

import logging
import math
from collections import defaultdict
from typing import TYPE_CHECKING, Any, Final, NamedTuple, TypeAlias

from sqlalchemy import (
    delete,
    func,
    insert,
    literal_column,
    select,
    text,
)

from eskin.wire.messages import Position
from eskin.wire.slot import slot_of
from eskin_cloud.store.key_batches import key_batches
from eskin_cloud.store.schema.node_key import of_boots, of_node, of_nodes, of_same_node
from eskin_cloud.store.schema.tables import (
    boot_ends,
    lost_ranges,
    missing_ranges,
    nodes,
    sequences,
)
from eskin_cloud.store.write.events import event_row, store_event

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Sequence

    from sqlalchemy import Connection, Select

    from eskin_cloud.store.feed_entry import FeedEntry
    from eskin_cloud.store.write.write_cache import WriteCache

log = logging.getLogger(__name__)

MAX_MISSING_RANGES: Final = 1000
"""Of a node; beyond it, the count is a lower bound."""
_MOST_NAMED: Final = 8
"""Ranges that an event lists."""

Span: TypeAlias = tuple[int, int]
Boot: TypeAlias = tuple[str, int]

_RECORD_LOST: Final = text(
    "INSERT INTO lost_ranges (slot, node, boot, first, last) "
    "VALUES (:slot, :node, :boot, :first, :last) "
    "ON CONFLICT (slot, node, boot, first) DO UPDATE SET last = excluded.last "
    "WHERE excluded.last > lost_ranges.last"
)
_RECORD_END: Final = text(
    "INSERT INTO boot_ends (slot, node, boot, last) VALUES (:slot, :node, :boot, :last) "
    "ON CONFLICT (slot, node, boot) DO UPDATE SET last = excluded.last "
    "WHERE excluded.last > boot_ends.last"
)


class MissingSpan(NamedTuple):
    """A range of missing messages.

    Attributes:
        boot: The node's boot.
        first: Its first number.
        last: Its last number.
        since: When it was first found missing, UTC ns.
        reported: Whether an event has reported it.
    """

    boot: int
    first: int
    last: int
    since: int
    reported: bool

    @property
    def messages(self) -> int:
        """The number of missing messages."""
        return self.last - self.first + 1


def record_lost(connection: Connection, node: str, spans: Iterable[tuple[int, int, int]]) -> None:
    """Record lost messages or dead letters: ranges of ``(boot, first, last)``.

    Adjacent ranges are merged.
    """
    o = lost_ranges.c
    for boot, first, last in spans:
        before = select(o.first, o.last).where(
            of_node(lost_ranges, node), o.boot == boot, o.first <= first
        )
        row = connection.execute(before.order_by(o.first.desc()).limit(1)).first()
        begin = first if row is None or row.last < first - 1 else row.first
        place = {"slot": slot_of(node), "node": node, "boot": boot}
        connection.execute(_RECORD_LOST, place | {"first": begin, "last": last})


def record_boot_ends(connection: Connection, node: str, stated: Iterable[tuple[int, int]]) -> None:
    """Record the greatest number of boots: ``(boot, last)``."""
    place = {"slot": slot_of(node), "node": node}
    rows = [place | {"boot": boot, "last": last} for boot, last in stated if last >= 0]
    if rows:
        connection.execute(_RECORD_END, rows)


def find_missing(connection: Connection) -> dict[Boot, list[Span]]:
    """The missing ranges, by node and boot, in order.

    What a node still holds in flash, by its latest status, is not missing.
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
    for query in (_between(), _at_end()):
        for node, boot, first, last in connection.execute(query):
            most = held.get(node, (math.inf, 0))
            if boot > most[0] or count[node] >= MAX_MISSING_RANGES:
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
    before = func.lag(s.last).over(partition_by=(s.slot, s.node, s.boot), order_by=s.first)
    first = (func.coalesce(before, -1) + 1).label("begin")
    ranges = select(s.slot, s.node, s.boot, first, (s.first - 1).label("finish"))
    r, o = ranges.subquery(), lost_ranges.c
    # Most explained gaps equal one lost range; these must not use up `MAX_MISSING_RANGES`.
    same = of_same_node(lost_ranges, r) & (o.boot == r.c.boot) & (o.first == r.c.begin)
    joined = r.outerjoin(lost_ranges, same & (o.last >= r.c.finish))
    query = select(r.c.node, r.c.boot, r.c.begin, r.c.finish).select_from(joined)
    query = query.where(r.c.begin <= r.c.finish, o.first.is_(None))
    return query.order_by(r.c.node, r.c.boot, r.c.begin)


def _at_end() -> Select[Any]:
    s, e = sequences.c, boot_ends.c
    stored = select(func.max(s.last)).where(of_same_node(sequences, boot_ends), s.boot == e.boot)
    begin = func.coalesce(stored.scalar_subquery(), -1) + 1
    return select(e.node, e.boot, begin, e.last).where(e.last >= begin).order_by(e.node, e.boot)


def find_missing_tails(
    connection: Connection, confirmed: Sequence[tuple[str, int, int]]
) -> list[tuple[str, int, int, int]]:
    """The missing ranges between a boot's last stored number and its confirmed end.

    Args:
        connection: Of the store.
        confirmed: Node, boot, and its greatest number.

    Returns:
        Node, boot, first and last number of each missing range.
    """
    s = sequences.c
    stored: dict[Boot, int] = {}
    keys = [(node, boot) for node, boot, _ in confirmed]
    query = select(s.node, s.boot, func.max(s.last)).group_by(s.slot, s.node, s.boot)
    for batch in key_batches(keys):
        here = of_boots(sequences, batch)
        for node, boot, last in connection.execute(query.where(here)):
            stored[node, boot] = last
    explained = _explained(connection, keys)
    return [
        (node, boot, first, end)
        for node, boot, last in confirmed
        for first, end in subtract(
            [(stored.get((node, boot), -1) + 1, last)], explained.get((node, boot), ())
        )
    ]


def _explained(connection: Connection, keys: Sequence[Boot]) -> dict[Boot, list[Span]]:
    explained: dict[Boot, list[Span]] = defaultdict(list)
    o = lost_ranges.c
    for batch in key_batches(keys):
        here = of_boots(lost_ranges, batch)
        query = select(o.node, o.boot, o.first, o.last).where(here).order_by(o.first)
        for node, boot, first, last in connection.execute(query):
            explained[node, boot].append((first, last))
    return explained


def subtract(spans: Iterable[Span], others: Sequence[Span]) -> list[Span]:
    """The parts of ranges that lie in no other range; ``others`` is sorted."""
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
    """The missing ranges of nodes, in order."""
    h = missing_ranges.c
    found: dict[str, list[MissingSpan]] = defaultdict(list)
    query = (
        select(missing_ranges)
        .where(of_nodes(missing_ranges, names))
        .order_by(h.node, h.boot, h.first)
    )
    for row in connection.execute(query):
        found[row.node].append(
            MissingSpan(row.boot, row.first, row.last, row.since, reported=bool(row.reported))
        )
    return found


def update_missing(
    connection: Connection,
    cache: WriteCache,
    nodes: Collection[str],
    found: dict[Boot, list[Span]],
    *,
    patience: int,
    now: int,
) -> list[FeedEntry]:
    """Update the missing ranges; report old ones, and reported ones that arrived.

    Args:
        connection: The writer's, in a transaction.
        cache: The writer's.
        nodes: Their ranges are updated.
        found: What `find_missing` gave of them.
        patience: Age in ns after which a range is reported.
        now: UTC ns.

    Returns:
        Entries for the live feed.
    """
    known: dict[Boot, list[MissingSpan]] = defaultdict(list)
    stored = select(missing_ranges).where(of_nodes(missing_ranges, nodes))
    for row in connection.execute(stored.order_by(missing_ranges.c.first)):
        hole = MissingSpan(row.boot, row.first, row.last, row.since, reported=bool(row.reported))
        known[row.node, row.boot].append(hole)
    entries = []
    for key in sorted(known.keys() | found.keys()):
        old = known[key]
        new = [_merged(key[1], span, old, patience, now) for span in found.get(key, ())]
        if new == old:
            continue
        here = of_node(missing_ranges, key[0]) & (missing_ranges.c.boot == key[1])
        connection.execute(delete(missing_ranges).where(here))
        if new:
            connection.execute(
                insert(missing_ranges), [{"node": key[0], **h._asdict()} for h in new]
            )
        fresh = [
            h for h in new if h.reported and not any(o.reported and _overlap(o, h) for o in old)
        ]
        gone = [h for h in old if h.reported and not any(_overlap(h, other) for other in new)]
        for word, spans, level in (("missing", fresh, log.error), ("found", gone, log.warning)):
            if spans:
                detail = _describe(word, key[1], spans)
                level("messages %s: node=%s %s", word, key[0], detail)
                position = Position(key[1], spans[0].first)
                time = min(h.since for h in spans), now
                event = event_row(key[0], "status", position, time, detail=detail)
                entries.append(store_event(connection, cache, event, now=now))
    return entries


def _merged(
    boot: int, span: Span, old: Iterable[MissingSpan], patience: int, now: int
) -> MissingSpan:
    met = [o for o in old if o.first <= span[1] and span[0] <= o.last]
    since = min([now, *(o.since for o in met)])
    return MissingSpan(
        boot, *span, since, reported=any(o.reported for o in met) or now - since >= patience
    )


def _overlap(one: MissingSpan, other: MissingSpan) -> bool:
    return one.first <= other.last and other.first <= one.last


def _describe(word: str, boot: int, missing: Sequence[MissingSpan]) -> str:
    spans = ", ".join(f"{h.first} to {h.last}" for h in missing[:_MOST_NAMED])
    rest = f" and {len(missing) - _MOST_NAMED} more ranges" if len(missing) > _MOST_NAMED else ""
    count = sum(h.messages for h in missing)
    return f"{word}: {count} message{'s' * (count != 1)} of boot {boot}: {spans}{rest}"


def count_missing(connection: Connection) -> int:
    """The number of missing messages of all nodes that an event has reported."""
    h = missing_ranges.c
    each = (h.last - h.first + 1) * literal_column("1.0")
    query = select(func.coalesce(func.sum(each), 0)).where(h.reported == 1)
    return int(connection.execute(query).scalar_one())


def describe_flash_rollback(
    connection: Connection, node: str, boot: int, stated: Sequence[tuple[int, int]]
) -> str | None:
    """Detect that a node's flash was wiped or rolled back.

    Args:
        connection: Of the store.
        node: The node.
        boot: Its present boot.
        stated: ``(boot, last)`` of its former boots, as its flash states them.

    Returns:
        A description for an event; ``None`` if the flash is up to date.
    """
    s = sequences.c
    query = select(s.boot, s.last).where(of_node(sequences, node), s.boot < boot)
    row = connection.execute(query.order_by(s.boot.desc(), s.last.desc()).limit(1)).first()
    latest = max(stated, default=(-1, -1))
    if row is None or tuple(row) <= latest:
        return None
    knows = f"ends in boot {latest[0]} at {latest[1]}" if stated else "states no former boot"
    return (
        f"flash wiped or rolled back: it {knows}, but boot {row[0]} is stored up to {row[1]}; "
        "messages that waited in it are lost"
    )
