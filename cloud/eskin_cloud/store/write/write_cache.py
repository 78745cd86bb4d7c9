"""The writer's cache of stored rows, written back once a transaction."""

from __future__ import annotations

import logging
from collections import defaultdict
from typing import TYPE_CHECKING, Any, Final, NoReturn, TypeAlias

from sqlalchemy import and_, bindparam, delete, insert, select, tuple_, update

from eskin.errors import StoreError
from eskin.wire.slot import SLOTS, key_of, slot_of
from eskin_cloud.store.damage import damaged_rows
from eskin_cloud.store.key_batches import key_batches
from eskin_cloud.store.notify import News, announce
from eskin_cloud.store.row_digests import intact_rows, without_digest
from eskin_cloud.store.schema.frame_tables import pages
from eskin_cloud.store.schema.node_key import of_boots, of_node
from eskin_cloud.store.schema.tables import feed, nodes, sequences
from eskin_cloud.store.shard_groups import hold_shard
from eskin_cloud.store.write.duplicates import StoredDigests, StoredSequences, stored_spans
from eskin_cloud.store.write.node_sites import sites_of

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable

    from sqlalchemy import ColumnElement, Connection, Table

log = logging.getLogger(__name__)

Row: TypeAlias = dict[str, Any]
Key: TypeAlias = tuple[Any, ...]
"""The columns of a row's primary key, which begins with a slot."""

MOVING: Final = "moving"
"""The writer's name while a store is moved."""
_MAX_BOOTS: Final = 10_000
_MAX_ROWS: Final = 100_000
"""Rows of nodes and pages together."""
_FEED: Final = (
    select(feed.c.slot, feed.c.cursor, feed.c.writer)
    .where(feed.c.slot.in_(bindparam("slots", expanding=True)))
    .order_by(feed.c.slot)
    .with_for_update()
)
"""Locks slots in ascending order, so that no two writers wait for each other."""
_SAVE_FEED: Final = (
    update(feed)
    .where(feed.c.slot == bindparam("at_slot"))
    .values(cursor=bindparam("cursor"), writer=bindparam("writer"))
)


def _by_key(table: Table) -> ColumnElement[bool]:
    """A condition on the key, as `_with_key_parameters` names it."""
    return and_(*(column == bindparam(f"at_{column.name}") for column in table.primary_key.columns))


_TABLES: Final = (nodes, pages, sequences)
# Compiled once: compiling a statement takes as long as executing it.
_INSERT: Final = {table: insert(table) for table in _TABLES}
_UPDATE: Final = {table: update(table).where(_by_key(table)) for table in _TABLES}
_DELETE: Final = {table: delete(table).where(_by_key(table)) for table in _TABLES}


class _SlotRows:
    """What is cached of the nodes of one slot.

    Attributes:
        sites: The site of each node.
        ranges: Stored sequence numbers, by node and boot.
        rows: Rows of nodes and pages; ``None`` where there is none.
        layouts: Accepted layouts, with their nodes.
        units: By node, the units of the channels in its layouts.
    """

    __slots__ = ("layouts", "ranges", "rows", "sites", "units")

    def __init__(self) -> None:
        self.sites: dict[str, str] = {}
        self.ranges: dict[tuple[str, int], StoredSequences] = {}
        self.rows: dict[Table, dict[Key, Row | None]] = {nodes: {}, pages: {}}
        self.layouts: set[tuple[str, bytes]] = set()
        self.units: dict[str, dict[str, str]] = {}

    def lasting(self) -> _SlotRows:
        """What no other process changes: sites, and layouts of which a page is stored."""
        kept = _SlotRows()
        kept.sites = self.sites
        stored = {(key[1], key[2]) for key, row in self.rows[pages].items() if row is not None}
        kept.layouts = self.layouts & stored
        return kept


class WriteCache:
    """Rows of nodes, pages and sequences, and the last cursors; `save` writes them back.

    Only the writer thread uses it. A rollback clears it; what another process has written of a
    slot drops all of that slot that may have changed.

    Args:
        name: Identifies the process to others.

    Attributes:
        name: The same.
        digests: Digests of stored messages.
    """

    def __init__(self, name: str = "") -> None:
        self.name = name
        self._cursors: dict[int, int] = {}
        self.clear()

    def __len__(self) -> int:
        """The number of nodes, pages and boots that are kept."""
        known = self._slots.values()
        rows = sum(len(rows) for each in known for rows in each.rows.values())
        return rows + sum(len(each.ranges) for each in known)

    def lock(self, connection: Connection, slots: Collection[int]) -> None:
        """Lock slots until the commit, and drop what others may have changed.

        At the beginning of a transaction that writes rows of nodes: what it reads afterwards
        is what the last writer of the slot has committed.

        Args:
            connection: The writer's, at the beginning of a transaction.
            slots: Those of all nodes whose rows the transaction writes.

        Raises:
            StoreError: A store is being moved here.
        """
        self._cursors.clear()
        hold_shard(connection, min(slots))
        for slot, cursor, writer in connection.execute(_FEED, {"slots": sorted(slots)}):
            if writer == MOVING:
                refuse_moving()
            if writer != self.name:
                self._slots[slot] = self._slots[slot].lasting()
                self.digests.forget(slot)
            self._cursors[slot] = cursor

    def clear(self) -> None:
        """Drop all cached rows and unsaved changes."""
        self._moved: set[int] = set()
        self.digests = StoredDigests()
        self._slots: defaultdict[int, _SlotRows] = defaultdict(_SlotRows)
        self._new: set[tuple[Table, Key]] = set()
        self._changed: dict[tuple[Table, Key], None] = {}
        self._added: dict[tuple[str, int], None] = {}

    def sites(self, connection: Connection, named: Collection[str]) -> dict[str, str]:
        """The sites of those nodes that have one; sites never change."""
        unknown = [node for node in named if node not in self._of(node).sites]
        if unknown:
            for node, site in sites_of(connection, unknown).items():
                self._of(node).sites[node] = site
        return {node: self._of(node).sites[node] for node in named if node in self._of(node).sites}

    def next_cursor(self, node: str) -> int:
        """The next cursor of a node's slot, which the transaction has locked."""
        slot = slot_of(node)
        self._moved.add(slot)
        self._cursors[slot] += SLOTS
        return self._cursors[slot]

    def prepare(
        self,
        connection: Connection,
        *,
        boots: Iterable[tuple[str, int]],
        of_pages: Collection[Key] = (),
    ) -> None:
        """Read the rows that a batch needs, a few statements for all.

        Args:
            connection: The writer's, in a transaction.
            boots: Nodes and their boots.
            of_pages: Keys of pages.
        """
        unknown = [key for key in dict.fromkeys(boots) if key not in self._of(key[0]).ranges]
        self._prepare_rows(connection, nodes, dict.fromkeys(key_of(node) for node, _ in unknown))
        self._prepare_rows(connection, pages, of_pages)
        if not unknown:
            return
        found: dict[tuple[str, int], list[tuple[int, int]]] = {key: [] for key in unknown}
        for part in key_batches(unknown):
            query = select(sequences).where(of_boots(sequences, part))
            for row in intact_rows(connection, sequences, connection.execute(query).mappings()):
                found[row["node"], row["boot"]].append((row["first"], row["last"]))
        for key, written in found.items():
            self._of(key[0]).ranges[key] = StoredSequences(sorted(written))
        if damaged_rows.of(sequences.name):
            for node, boot in unknown:
                self._restore_ranges(connection, node, boot)

    def _restore_ranges(self, connection: Connection, node: str, boot: int) -> None:
        """Read a boot's ranges from its digests, and write them anew if they differ."""
        restored = StoredSequences()
        for first, last in stored_spans(connection, node, boot):
            restored.add(first, last)
        ranges = self._of(node).ranges
        if list(restored) != list(ranges[node, boot]):
            log.warning("stored ranges restored from digests: node=%s boot=%d", node, boot)
            s = sequences.c
            connection.execute(delete(sequences).where(of_node(sequences, node), s.boot == boot))
            ranges[node, boot] = restored
            self.mark_ranges_changed(node, boot)

    def _prepare_rows(self, connection: Connection, table: Table, keys: Iterable[Key]) -> None:
        unknown = [key for key in keys if key not in self._rows(table, key)]
        columns = table.primary_key.columns
        for key in unknown:
            self._rows(table, key)[key] = None
        for part in key_batches(unknown):
            query = select(table).where(tuple_(*columns).in_(part))
            for row in connection.execute(query).mappings():
                key = tuple(row[column.name] for column in columns)
                self._rows(table, key)[key] = without_digest(row)

    def ranges(self, connection: Connection, node: str, boot: int) -> StoredSequences:
        """The stored sequence numbers of a node's boot."""
        key, ranges = (node, boot), self._of(node).ranges
        if key not in ranges:
            self.prepare(connection, boots=[key])
        return ranges[key]

    def add(
        self, connection: Connection, node: str, boot: int, sequence: int, digest: bytes
    ) -> None:
        """Add a stored message's sequence number and digest."""
        self.ranges(connection, node, boot).add(sequence)
        self.digests.added(node, boot)[sequence] = digest
        self.mark_ranges_changed(node, boot)

    def mark_ranges_changed(self, node: str, boot: int) -> None:
        """Have `save` write the ranges of a boot, which the caller changed."""
        self._added[node, boot] = None

    def row(self, connection: Connection, table: Table, *key: Any) -> Row | None:
        """A node's or a page's row; call `change` after changing it."""
        rows = self._rows(table, key)
        if key not in rows:
            query = select(table)
            for column, value in zip(table.primary_key.columns, key, strict=True):
                query = query.where(column == value)
            found = connection.execute(query).mappings().one_or_none()
            rows[key] = None if found is None else without_digest(found)
        return rows[key]

    def is_accepted(self, node: str, layout: bytes) -> bool:
        """Whether a node's messages may be read by a layout (`write.layouts`)."""
        return (node, layout) in self._of(node).layouts

    def accept(self, node: str, layout: bytes, units: dict[str, str]) -> None:
        """Accept a layout.

        Args:
            node: The node.
            layout: The layout's hash.
            units: The units of the channels in all layouts of the node.
        """
        self._of(node).layouts.add((node, layout))
        self.keep_units(node, units)

    def units(self, node: str) -> dict[str, str] | None:
        """The units of the channels in a node's layouts; ``None`` if they were not read."""
        return self._of(node).units.get(node)

    def keep_units(self, node: str, units: dict[str, str]) -> None:
        """Keep the units of the channels in a node's layouts."""
        self._of(node).units[node] = units

    def create(self, table: Table, key: Key, row: Row) -> None:
        """Add a new row."""
        self._rows(table, key)[key] = row
        self._new.add((table, key))
        self._changed[table, key] = None

    def change(self, table: Table, *key: Any) -> None:
        """Have `save` write a row."""
        self._changed[table, key] = None

    def save(self, connection: Connection) -> None:
        """Write the changes, in the transaction of the messages that caused them."""
        if self._changed or self._added or self._moved:
            self._write(connection)
        self._trim()

    def _write(self, connection: Connection) -> None:
        touched = self._moved | {key[0] for _, key in self._changed}
        touched |= {slot_of(node) for node, _ in self._added}
        feeds = [
            {"at_slot": slot, "cursor": self._cursors[slot], "writer": self.name}
            for slot in touched
        ]
        connection.execute(_SAVE_FEED, feeds)
        # One statement a table: a batch of a fleet changes thousands of rows.
        changed: dict[Table, list[Row]] = {}
        fresh: dict[Table, list[Row]] = {}
        for table, key in self._changed:
            row = self._rows(table, key)[key]
            if row is not None:
                kind = fresh if (table, key) in self._new else changed
                kind.setdefault(table, []).append(row)
        for table, rows in fresh.items():
            connection.execute(_INSERT[table], rows)
        for table, rows in changed.items():
            connection.execute(_UPDATE[table], _with_key_parameters(table, rows))
        self._changed.clear()
        self._new.clear()
        self._save_ranges(connection)
        announce(connection, News({slot: self._cursors[slot] for slot in self._moved}))
        self._moved.clear()

    def _save_ranges(self, connection: Connection) -> None:
        gone: list[Row] = []
        grown: list[Row] = []
        fresh: list[Row] = []
        for node, boot in self._added:
            ranges = self._of(node).ranges[node, boot]
            for first, before, now in ranges.changes():
                place: Row = {"slot": slot_of(node), "node": node, "boot": boot, "first": first}
                if now is None:
                    gone.append(place)
                else:
                    (fresh if before is None else grown).append(place | {"last": now})
            ranges.written()
        if gone:
            connection.execute(_DELETE[sequences], _with_key_parameters(sequences, gone))
        if grown:
            connection.execute(_UPDATE[sequences], _with_key_parameters(sequences, grown))
        if fresh:
            connection.execute(_INSERT[sequences], fresh)
        self._added.clear()
        self.digests.save(connection)

    def _trim(self) -> None:
        """Drop written rows if there are many."""
        known = self._slots.values()
        if (
            sum(len(each.ranges) for each in known) > _MAX_BOOTS
            or sum(len(rows) for each in known for rows in each.rows.values()) > _MAX_ROWS
            or sum(len(each.layouts) + len(each.sites) for each in known) > _MAX_ROWS
            or sum(len(units) for each in known for units in each.units.values()) > _MAX_ROWS
        ):
            self._slots.clear()

    def _of(self, node: str) -> _SlotRows:
        return self._slots[slot_of(node)]

    def _rows(self, table: Table, key: Key) -> dict[Key, Row | None]:
        return self._slots[key[0]].rows[table]


def refuse_moving() -> NoReturn:
    """Refuse to write while a store is moved.

    Raises:
        StoreError: Always.
    """
    raise StoreError("a store is being moved here; wait for `eskin cloud move`, or start it again")


def _with_key_parameters(table: Table, rows: Iterable[Row]) -> list[Row]:
    """Rows as parameters of `_UPDATE` and `_DELETE`."""
    keys = {column.name for column in table.primary_key.columns}
    return [
        {f"at_{name}" if name in keys else name: value for name, value in row.items()}
        for row in rows
    ]
