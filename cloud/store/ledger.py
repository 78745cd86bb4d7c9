"""What the writing thread remembers of the store, so that it need not ask for every message."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final, TypeAlias

from sqlalchemy import delete, insert, select, update

from cloud.store.schema import channels, feed, nodes, sequences
from eskin.sequences import SequenceRanges

if TYPE_CHECKING:
    from sqlalchemy import Connection, Table

Row: TypeAlias = dict[str, Any]

_MOST_RANGES: Final = 10_000


class Ledger:
    """Rows of nodes, channels and sequences, and the last cursor; written back by `save`.

    Only the writing thread uses it. After a rollback it is forgotten and read anew.
    """

    def __init__(self) -> None:
        self.forget()

    def forget(self) -> None:
        """Drop everything that is remembered."""
        self._cursor: int | None = None
        self._ranges: dict[tuple[str, int], SequenceRanges] = {}
        self._written: dict[tuple[str, int], dict[int, int]] = {}
        self._rows: dict[Table, dict[tuple[str, ...], Row | None]] = {nodes: {}, channels: {}}
        self._new: set[tuple[Table, tuple[str, ...]]] = set()
        self._changed: dict[tuple[Table, tuple[str, ...]], None] = {}
        self._added: dict[tuple[str, int], None] = {}

    def next_cursor(self, connection: Connection) -> int:
        """The next place in the feed."""
        if self._cursor is None:
            self._cursor = connection.execute(select(feed.c.cursor)).scalar_one()
        self._cursor += 1
        return self._cursor

    def ranges(self, connection: Connection, node: str, boot: int) -> SequenceRanges:
        """What was stored of one boot of a node."""
        key = node, boot
        if key not in self._ranges:
            where = (sequences.c.node == node) & (sequences.c.boot == boot)
            found = connection.execute(select(sequences.c.first, sequences.c.last).where(where))
            self._written[key] = {row.first: row.last for row in found}
            self._ranges[key] = SequenceRanges(sorted(self._written[key].items()))
        return self._ranges[key]

    def add(self, connection: Connection, node: str, boot: int, sequence: int) -> None:
        """Remember that a message is stored."""
        self.ranges(connection, node, boot).add(sequence)
        self._added[node, boot] = None

    def row(self, connection: Connection, table: Table, *key: str) -> Row | None:
        """A node's or a channel's row; changes of it count after `change`."""
        rows = self._rows[table]
        if key not in rows:
            query = select(table)
            for column, value in zip(table.primary_key.columns, key, strict=True):
                query = query.where(column == value)
            found = connection.execute(query).mappings().one_or_none()
            rows[key] = None if found is None else dict(found)
        return rows[key]

    def create(self, table: Table, key: tuple[str, ...], row: Row) -> None:
        """Add a row that is not there yet."""
        self._rows[table][key] = row
        self._new.add((table, key))
        self._changed[table, key] = None

    def change(self, table: Table, *key: str) -> None:
        """Have a row written."""
        self._changed[table, key] = None

    def save(self, connection: Connection) -> None:
        """Write what changed, within the transaction of what it speaks of."""
        if self._cursor is not None:
            connection.execute(update(feed).values(cursor=self._cursor))
        for table, key in self._changed:
            row = self._rows[table][key]
            if row is None:
                continue
            if (table, key) in self._new:
                connection.execute(insert(table), row)
            else:
                query = update(table)
                for column, value in zip(table.primary_key.columns, key, strict=True):
                    query = query.where(column == value)
                connection.execute(query.values(row))
        self._changed.clear()
        self._new.clear()
        self._save_ranges(connection)

    def _save_ranges(self, connection: Connection) -> None:
        for node, boot in self._added:
            before = self._written[node, boot]
            after = dict(self._ranges[node, boot])
            here = (sequences.c.node == node) & (sequences.c.boot == boot)
            for first in before.keys() - after.keys():
                connection.execute(delete(sequences).where(here, sequences.c.first == first))
            for first in after.keys() & before.keys():
                if after[first] != before[first]:
                    connection.execute(
                        update(sequences)
                        .where(here, sequences.c.first == first)
                        .values(last=after[first])
                    )
            fresh = [
                {"node": node, "boot": boot, "first": first, "last": after[first]}
                for first in after.keys() - before.keys()
            ]
            if fresh:
                connection.execute(insert(sequences), fresh)
            self._written[node, boot] = after
        self._added.clear()
        if len(self._ranges) > _MOST_RANGES:
            self._ranges.clear()
            self._written.clear()
