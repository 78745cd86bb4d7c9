"""What the writing thread remembers of the store, so that it need not ask for every message."""

from __future__ import annotations

import secrets
from typing import TYPE_CHECKING, Any, Final, TypeAlias, TypeVar

from sqlalchemy import bindparam, delete, func, select, text, tuple_, update

from eskin.errors import StoreError
from eskin_cloud.store.notify import FEED, notify
from eskin_cloud.store.row_digests import without_digest
from eskin_cloud.store.sample_grid import CHUNK, grain_for
from eskin_cloud.store.schema.tables import channels, feed, nodes, sequences
from eskin_cloud.store.schema.tile_tables import stale
from eskin_cloud.store.write.node_sites import sites_of
from eskin_cloud.store.write.prepared_statements import ADD, CHANGE, REMOVE, placed
from eskin_cloud.store.write.stored_digests import StoredDigests
from eskin_cloud.store.write.stored_sequences import StoredSequences

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Iterator, Sequence

    from sqlalchemy import Connection, Table

    from eskin_cloud.store.sample_grid import SampleGrid

Row: TypeAlias = dict[str, Any]
T = TypeVar("T")

MOVING: Final = "moving"
"""Who writes while a store is moved to another place."""
_MOST_ASKED: Final = 4000
"""Keys in one statement: some builds of SQLite take 32,766 values, PostgreSQL takes 65,535."""
_MOST_BOOTS: Final = 10_000
_MOST_ROWS: Final = 100_000
"""Of nodes and channels: a node may name as many channels as it likes."""
_WRITER: Final = select(feed.c.writer)
_OUTDATE: Final = text(
    "INSERT INTO stale (node, channel, chunk, mark) VALUES (:node, :channel, :chunk, :mark) "
    "ON CONFLICT (node, channel, chunk) DO UPDATE SET mark = excluded.mark"
)
_RAZE: Final = delete(stale).where(
    stale.c.node == bindparam("n"), stale.c.channel == bindparam("c")
)


class WriteCache:
    """Rows of nodes, channels and sequences, and the last cursor; written back by `save`.

    Only the writing thread uses it. After a rollback, and after somebody else wrote, it is
    forgotten and read anew.

    Attributes:
        name: By which others know who wrote.
        digests: Of what is stored.
    """

    def __init__(self) -> None:
        self.name = secrets.token_hex(16)
        self.forget()

    def refresh(self, connection: Connection) -> None:
        """Drop what somebody else may have changed; at the beginning of each transaction.

        Raises:
            StoreError: Not all is there yet: a store is being moved here.
        """
        writer = connection.execute(_WRITER).scalar_one()
        if writer == MOVING:
            raise StoreError(
                "a store is being moved here; let `eskin cloud move` end, or start it again"
            )
        if writer != self.name:
            self.forget()

    def forget(self) -> None:
        """Drop everything that is remembered."""
        self._cursor: int | None = None
        self._moved = False
        self.digests = StoredDigests()
        self._sites: dict[str, str] = {}
        self._ranges: dict[tuple[str, int], StoredSequences] = {}
        self._rows: dict[Table, dict[tuple[str, ...], Row | None]] = {nodes: {}, channels: {}}
        self._channels_of: dict[str, int] = {}
        self._new: set[tuple[Table, tuple[str, ...]]] = set()
        self._changed: dict[tuple[Table, tuple[str, ...]], None] = {}
        self._added: dict[tuple[str, int], None] = {}
        self._outdated: dict[tuple[str, str, int], None] = {}
        self._razed: dict[tuple[str, str], None] = {}

    def sites(self, connection: Connection, named: Collection[str]) -> dict[str, str]:
        """The sites of nodes, without those that have none yet; they never change."""
        unknown = [node for node in named if node not in self._sites]
        if unknown:
            if len(self._sites) > _MOST_ROWS:
                self._sites.clear()
                unknown = list(named)
            self._sites |= sites_of(connection, unknown)
        return {node: self._sites[node] for node in named if node in self._sites}

    def next_cursor(self, connection: Connection) -> int:
        """The next place in the feed."""
        if self._cursor is None:
            self._cursor = connection.execute(select(feed.c.cursor)).scalar_one()
        self._cursor += 1
        self._moved = True
        return self._cursor

    def prepare(
        self,
        connection: Connection,
        *,
        boots: Iterable[tuple[str, int]],
        places: Collection[tuple[str, str]],
    ) -> None:
        """Read at once what a batch will ask for, where it is not remembered.

        Args:
            connection: The writing thread's, in a transaction.
            boots: Nodes and their boots.
            places: Nodes and their channels.
        """
        unknown = [key for key in dict.fromkeys(boots) if key not in self._ranges]
        self._prepare_rows(connection, nodes, dict.fromkeys((node,) for node, _ in unknown))
        self._prepare_rows(connection, channels, places)
        self._prepare_counts(connection, places)
        if not unknown:
            return
        found: dict[tuple[str, int], list[tuple[int, int]]] = {key: [] for key in unknown}
        s = sequences.c
        query = select(s.node, s.boot, s.first, s.last)
        for part in _parts(unknown):
            here = tuple_(s.node, s.boot).in_(part)
            for node, boot, first, last in connection.execute(query.where(here)):
                found[node, boot].append((first, last))
        for key, written in found.items():
            self._ranges[key] = StoredSequences(sorted(written))

    def _prepare_rows(
        self, connection: Connection, table: Table, keys: Iterable[tuple[str, ...]]
    ) -> None:
        rows = self._rows[table]
        unknown = [key for key in keys if key not in rows]
        if not unknown:
            return
        columns = table.primary_key.columns
        rows.update(dict.fromkeys(unknown))
        for part in _parts(unknown):
            query = select(table).where(tuple_(*columns).in_(part))
            for row in connection.execute(query).mappings():
                rows[tuple(row[column.name] for column in columns)] = without_digest(row)

    def _prepare_counts(self, connection: Connection, places: Iterable[tuple[str, str]]) -> None:
        known = self._rows[channels]
        growing = dict.fromkeys(node for node, channel in places if not known[node, channel])
        unknown = [node for node in growing if node not in self._channels_of]
        here = channels.c.node
        query = select(here, func.count()).group_by(here)
        for part in _parts(unknown):
            self._channels_of |= dict.fromkeys(part, 0)
            for node, count in connection.execute(query.where(here.in_(part))):
                self._channels_of[node] = count

    def ranges(self, connection: Connection, node: str, boot: int) -> StoredSequences:
        """What was stored of one boot of a node."""
        key = node, boot
        if key not in self._ranges:
            where = (sequences.c.node == node) & (sequences.c.boot == boot)
            found = connection.execute(select(sequences.c.first, sequences.c.last).where(where))
            self._ranges[key] = StoredSequences(sorted((row.first, row.last) for row in found))
        return self._ranges[key]

    def add(
        self, connection: Connection, node: str, boot: int, sequence: int, digest: bytes
    ) -> None:
        """Remember that a message is stored, with its digest."""
        self.ranges(connection, node, boot).add(sequence)
        self.digests.added(node, boot)[sequence] = digest
        self.grow(node, boot)

    def grow(self, node: str, boot: int) -> None:
        """Have the ranges of a boot written, to which somebody added what is stored."""
        self._added[node, boot] = None

    def row(self, connection: Connection, table: Table, *key: str) -> Row | None:
        """A node's or a channel's row; changes of it count after `change`."""
        rows = self._rows[table]
        if key not in rows:
            query = select(table)
            for column, value in zip(table.primary_key.columns, key, strict=True):
                query = query.where(column == value)
            found = connection.execute(query).mappings().one_or_none()
            rows[key] = None if found is None else without_digest(found)
        return rows[key]

    def count_channels(self, connection: Connection, node: str) -> int:
        """How many channels a node has; ask before `create`, which counts on."""
        if node not in self._channels_of:
            query = select(func.count()).select_from(channels).where(channels.c.node == node)
            self._channels_of[node] = connection.execute(query).scalar_one()
        return self._channels_of[node]

    def create(self, table: Table, key: tuple[str, ...], row: Row) -> None:
        """Add a row that is not there yet."""
        self._rows[table][key] = row
        if table is channels and key[0] in self._channels_of:
            self._channels_of[key[0]] += 1
        self._new.add((table, key))
        self._changed[table, key] = None

    def change(self, table: Table, *key: str) -> None:
        """Have a row written."""
        self._changed[table, key] = None

    def outdate(self, channel: Row, comb: SampleGrid, *, since: int = -(2**63)) -> None:
        """Have a channel's pyramid made anew where a row's samples are, up to where there is one.

        Samples that touch many of its chunks have all of it made anew, of longer ones: otherwise a
        node that first samples each nanosecond, and then each hour, would have billions marked.

        Args:
            channel: The channel's row.
            comb: The row's samples.
            since: What lies before, UTC ns, is good; a whole chunk's beginning.
        """
        if channel["built"] is None:
            return
        grain = grain_for(channel["grain"], comb)
        if grain > channel["grain"]:
            self._raze(channel, grain)
            return
        for chunk in comb.chunks(grain):
            if since <= chunk << (grain + CHUNK) < channel["built"]:
                self._outdated[channel["node"], channel["channel"], chunk] = None

    def _raze(self, channel: Row, grain: int) -> None:
        """Count a channel's pyramid as not built; who builds it anew clears what is left of it."""
        place = channel["node"], channel["channel"]
        channel |= {"built": None, "grain": grain}
        self._razed[place] = None
        self._outdated = {key: None for key in self._outdated if key[:2] != place}
        self.change(channels, *place)

    def save(self, connection: Connection) -> None:
        """Write what changed, within the transaction of what it speaks of."""
        if self._changed or self._added or self._moved:
            self._write(connection)
        self._trim()

    def _write(self, connection: Connection) -> None:
        if self._razed:
            connection.execute(_RAZE, [{"n": node, "c": channel} for node, channel in self._razed])
            self._razed.clear()
        if self._outdated:
            connection.execute(_OUTDATE, [_stale_row(*key) for key in self._outdated])
            self._outdated.clear()
        values = {"writer": self.name} | ({"cursor": self._cursor} if self._moved else {})
        connection.execute(update(feed).values(values))
        if self._moved:
            notify(connection, FEED, self._cursor, self.name)
        self._moved = False
        # One statement for all rows of a kind: a batch of a fleet changes thousands.
        changed: dict[Table, list[Row]] = {}
        fresh: dict[Table, list[Row]] = {}
        for table, key in self._changed:
            row = self._rows[table][key]
            if row is not None:
                kind = fresh if (table, key) in self._new else changed
                kind.setdefault(table, []).append(row)
        for table, rows in fresh.items():
            connection.execute(ADD[table], rows)
        for table, rows in changed.items():
            connection.execute(CHANGE[table], placed(table, rows))
        self._changed.clear()
        self._new.clear()
        self._save_ranges(connection)

    def _save_ranges(self, connection: Connection) -> None:
        gone: list[Row] = []
        grown: list[Row] = []
        fresh: list[Row] = []
        for node, boot in self._added:
            ranges = self._ranges[node, boot]
            for first, before, now in ranges.changes():
                place: Row = {"node": node, "boot": boot, "first": first}
                if now is None:
                    gone.append(place)
                else:
                    (fresh if before is None else grown).append(place | {"last": now})
            ranges.written()
        if gone:
            connection.execute(REMOVE[sequences], placed(sequences, gone))
        if grown:
            connection.execute(CHANGE[sequences], placed(sequences, grown))
        if fresh:
            connection.execute(ADD[sequences], fresh)
        self._added.clear()
        self.digests.save(connection)

    def _trim(self) -> None:
        """Forget what is written, where it is much."""
        if len(self._ranges) > _MOST_BOOTS:
            self._ranges.clear()
        if sum(map(len, self._rows.values())) > _MOST_ROWS:
            for rows in self._rows.values():
                rows.clear()
            self._channels_of.clear()


def _parts(keys: Sequence[T]) -> Iterator[Sequence[T]]:
    """So many at a time as any database can be asked for at once."""
    for begin in range(0, len(keys), _MOST_ASKED):
        yield keys[begin : begin + _MOST_ASKED]


def _stale_row(node: str, channel: str, chunk: int) -> Row:
    return {"node": node, "channel": channel, "chunk": chunk, "mark": secrets.randbits(62)}
