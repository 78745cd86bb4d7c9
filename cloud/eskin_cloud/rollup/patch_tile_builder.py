"""Build tiles of patches in the background: claim chunks, build them, then write them.

To claim chunks marks them as stale, and the patch as built beyond them. From then on a row that
compaction adds late, or that is removed, marks its chunk again, in its own transaction. Chunks and
the levels above are built from a snapshot, without the write lock. They are written if neither the
marks nor the replaced chunks changed, and built again otherwise.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from sqlalchemy import delete, insert, select, tuple_

from eskin.runtime.digest import digest
from eskin.wire.slot import SLOTS, slot_of
from eskin_cloud.rollup.column_aggregates import joined, pack
from eskin_cloud.rollup.patch_tiles import fold_chunks, read_chunk, taxels_of
from eskin_cloud.store.patch_totals import Place, mark_chunks, read_totals, save_built
from eskin_cloud.store.read.window import before
from eskin_cloud.store.sample_grid import PATCH_CHUNK, STEP, TOP
from eskin_cloud.store.schema.frame_tables import (
    patch_rows,
    patch_tiles,
    patches,
    stale_patch_chunks,
)

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from sqlalchemy import Connection

    from eskin_cloud.rollup.column_aggregates import ColumnAggregates
    from eskin_cloud.store import Store

_Number = tuple[int, int]
"""Level and number of a chunk."""
_ROWS: Final = 4096
"""Rows whose chunks are marked at once."""
_CLEARED: Final = 256
"""Old tiles that are deleted at once."""
_AT_ONCE: Final = 64
"""Chunks that are built, and written, at once."""


@dataclass(frozen=True, slots=True)
class BuiltTiles:
    """Built chunks of a patch.

    Attributes:
        place: The patch.
        marks: Of each chunk of the lowest level the mark at that time.
        old: Digests of the chunks that are replaced, as far as there are any.
        new: All chunks, of every level; empty bytes where no sample is left.
    """

    place: Place
    marks: Mapping[int, int]
    old: Mapping[_Number, bytes]
    new: Mapping[_Number, bytes]


def build(store: Store) -> None:
    """Build all tiles that are due.

    Raises:
        StoreError: The store cannot be read or written.
    """
    for place in find_unclaimed(store):
        while claim(store, place):
            pass
    stale = find_stale(store, None)
    while stale is not None:
        while rebuild(store, stale):
            pass
        stale = find_stale(store, stale)


def find_unclaimed(store: Store, slots: Iterable[int] = range(SLOTS)) -> list[Place]:
    """Patches with complete chunks that are not claimed.

    Args:
        store: The store.
        slots: Whose nodes' patches are given.

    Raises:
        StoreError: The store cannot be read.
    """
    p = patches.c
    query = select(p.node, p.patch, p.grain, p.built, p.t_first, p.t_last)
    with store.read() as connection:
        rows = connection.execute(query.where(p.rows > 0, p.slot.in_(list(slots)))).mappings().all()
    return [
        Place(row["node"], row["patch"])
        for row in rows
        if (row["t_first"] if row["built"] is None else row["built"])
        < _begin(row["t_last"], row["grain"])
    ]


def _begin(instant: int, grain: int) -> int:
    """The start of the chunk that holds a time."""
    return instant >> (grain + PATCH_CHUNK) << (grain + PATCH_CHUNK)


def claim(store: Store, place: Place) -> bool:
    """Claim some of a patch's chunks; returns whether there are more.

    Raises:
        StoreError: The store cannot be written.
    """
    return store.write_node(place.node, lambda connection, _: _claim(connection, place)).result()


def _claim(connection: Connection, place: Place) -> bool:
    row = read_totals(connection, place)
    if row is None or row["t_last"] is None:
        return False
    grain, built = row["grain"], row["built"]
    if built is None and _clear(connection, place):
        return True
    since = _begin(row["t_first"], grain) if built is None else built
    horizon = _begin(row["t_last"], grain)
    r, bits = patch_rows.c, grain + PATCH_CHUNK
    query = select(r.t, r.t_end).where(place.within(patch_rows))
    query = query.where(r.t >= before(since, row["longest"]), r.t < horizon, r.t_end >= since)
    rows = connection.execute(query.order_by(r.t).limit(_ROWS)).all()
    if len(rows) == _ROWS:  # later rows begin after the last one; one chunk is always complete
        horizon = min(horizon, max(_begin(rows[-1][0], grain), since + (1 << bits)))
    if horizon <= since:
        return False
    numbers = {n for t, t_end in rows for n in range(t >> bits, (t_end >> bits) + 1)}
    mark_chunks(connection, place, (n for n in numbers if since <= n << bits < horizon))
    save_built(connection, place, horizon)
    return len(rows) == _ROWS


def _clear(connection: Connection, place: Place) -> bool:
    """Delete some old tiles; returns whether there were any."""
    t = patch_tiles.c
    here = place.within(patch_tiles)
    old = select(t.level, t.chunk).where(here).limit(_CLEARED)
    found = connection.execute(delete(patch_tiles).where(here, tuple_(t.level, t.chunk).in_(old)))
    return found.rowcount > 0


def find_stale(
    store: Store, after: Place | None, slots: Iterable[int] = range(SLOTS)
) -> Place | None:
    """The next patch with stale chunks.

    Args:
        store: The store.
        after: The patch before it; ``None``: the first one is given.
        slots: Whose nodes' patches count.

    Raises:
        StoreError: The store cannot be read.
    """
    s = stale_patch_chunks.c
    query = select(s.node, s.patch).where(s.slot.in_(list(slots)))
    query = query.order_by(s.slot, s.node, s.patch).limit(1)
    if after is not None:
        last = slot_of(after.node), after.node, after.patch
        query = query.where(tuple_(s.slot, s.node, s.patch) > tuple_(*last))
    with store.read() as connection:
        found = connection.execute(query).first()
    return None if found is None else Place(*found)


def rebuild(store: Store, place: Place) -> bool:
    """Rebuild some of a patch's stale chunks; returns whether there may be more.

    Raises:
        StoreError: The store cannot be read or written.
    """
    with store.read() as connection:
        made = _build(connection, place)
    if made is None:
        return False
    return store.write_node(place.node, lambda connection, _: _write(connection, made)).result()


def _build(connection: Connection, place: Place) -> BuiltTiles | None:
    s, row = stale_patch_chunks.c, read_totals(connection, place)
    query = select(s.chunk, s.mark).where(place.within(stale_patch_chunks))
    found = connection.execute(query.order_by(s.chunk).limit(_AT_ONCE)).all()
    if row is None or not found:
        return None
    marks = {int(chunk): int(mark) for chunk, mark in found}
    grain = row["grain"]
    level = grain
    chunks = fold_chunks(connection, place, grain, marks)
    old, new = _digests(connection, place, level, list(chunks)), _packed(level, chunks)
    while level + STEP <= TOP:
        level += STEP
        chunks, standing = _next_level(connection, place, level, chunks)
        old |= standing
        new |= _packed(level, chunks)
    return BuiltTiles(place, marks, old, new)


def _packed(level: int, chunks: Mapping[int, ColumnAggregates | None]) -> dict[_Number, bytes]:
    return {(level, n): b"" if each is None else pack(each) for n, each in chunks.items()}


def _next_level(
    connection: Connection,
    place: Place,
    level: int,
    below: Mapping[int, ColumnAggregates | None],
) -> tuple[dict[int, ColumnAggregates | None], dict[_Number, bytes]]:
    """The chunks of a level above some changed chunks, and the digests of those they replace."""
    changed = np.array(sorted(below), np.int64)
    parts: dict[int, list[ColumnAggregates]] = {n >> STEP: [] for n in below}
    digests = {}
    for number, data, own in _standing(connection, place, level, list(parts)):
        digests[level, number] = own
        chunk = read_chunk(connection, place, level, number, (data, own))
        if chunk is not None:
            old = chunk.all(taxels_of(connection, place.node, chunk))
            beneath = old.pieces.first >> (level - STEP + PATCH_CHUNK)
            parts[number].append(old.chosen(~np.isin(beneath, changed)))
    for number, each in below.items():
        if each is not None:
            parts[number >> STEP].append(each.grouped(level))
    return {
        number: joined(mine) if any(len(each.pieces) for each in mine) else None
        for number, mine in parts.items()
    }, digests


def _standing(
    connection: Connection, place: Place, level: int, numbers: Sequence[int]
) -> Sequence[Any]:
    t = patch_tiles.c
    query = select(t.chunk, t.data, t.digest).where(place.within(patch_tiles))
    return connection.execute(query.where(t.level == level, t.chunk.in_(numbers))).all()


def _digests(
    connection: Connection, place: Place, level: int, numbers: Sequence[int]
) -> dict[_Number, bytes]:
    return {(level, number): own for number, _, own in _standing(connection, place, level, numbers)}


def _write(connection: Connection, made: BuiltTiles) -> bool:
    """Write chunks, unless a row changed meanwhile; returns whether they were written."""
    s, t, place = stale_patch_chunks.c, patch_tiles.c, made.place
    here = place.within(stale_patch_chunks) & s.chunk.in_(list(made.marks))
    found = connection.execute(select(s.chunk, s.mark).where(here))
    marks = {int(chunk): int(mark) for chunk, mark in found}
    built = place.within(patch_tiles) & tuple_(t.level, t.chunk).in_(list(made.new))
    query = select(t.level, t.chunk, t.digest).where(built)
    old = {(level, number): own for level, number, own in connection.execute(query)}
    if marks != made.marks or old != made.old:
        return False
    connection.execute(delete(stale_patch_chunks).where(here))
    connection.execute(delete(patch_tiles).where(built))
    rows = [
        place.key | {"level": level, "chunk": number, "data": data, "digest": digest(data)}
        for (level, number), data in made.new.items()
        if data
    ]
    if rows:
        connection.execute(insert(patch_tiles), rows)
    return True
