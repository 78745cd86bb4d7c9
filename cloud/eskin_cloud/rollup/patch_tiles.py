"""Read tiles of patches.

A chunk holds `PATCH_CHUNK` tiles of a level of all columns in one row. Chunks are
made of compacted rows; where these are not in them yet, and where frames wait that came late,
samples are read instead.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np
from sqlalchemy import bindparam, select

from eskin.errors import MessageError
from eskin.wire.slot import slot_of
from eskin.wire.timestamp import MOST_INSTANT
from eskin_cloud.rollup.aggregates import EMPTY, Aggregates
from eskin_cloud.rollup.buckets import Buckets
from eskin_cloud.rollup.column_aggregates import (
    PackedAggregates,
    pack,
    read_columns,
    united,
    unpack,
)
from eskin_cloud.rollup.patch_folding import fold_runs
from eskin_cloud.rollup.ranges import Range, coarsened, merged
from eskin_cloud.store.damage import is_intact_tile
from eskin_cloud.store.descriptions import find_patch
from eskin_cloud.store.patch_totals import Place
from eskin_cloud.store.read.patch_runs import find_patch_pages, read_compacted
from eskin_cloud.store.read.window import before
from eskin_cloud.store.sample_grid import PATCH_CHUNK
from eskin_cloud.store.schema.frame_tables import frames, patch_tiles, stale_patch_chunks

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from sqlalchemy import Connection

    from eskin_cloud.rollup.column_aggregates import ColumnAggregates
    from eskin_cloud.store.read.lookup import Channel

_HERE: Final = (
    patch_tiles.c.slot == bindparam("slot"),
    patch_tiles.c.node == bindparam("node"),
    patch_tiles.c.patch == bindparam("patch"),
    patch_tiles.c.level == bindparam("level"),
)
_TILES: Final = (
    select(patch_tiles.c.chunk, patch_tiles.c.data, patch_tiles.c.digest)
    .where(*_HERE, patch_tiles.c.chunk.between(bindparam("first"), bindparam("last")))
    .order_by(patch_tiles.c.chunk)
)
_STALE: Final = select(stale_patch_chunks.c.chunk).where(
    stale_patch_chunks.c.slot == bindparam("slot"),
    stale_patch_chunks.c.node == bindparam("node"),
    stale_patch_chunks.c.patch == bindparam("patch"),
    stale_patch_chunks.c.chunk.between(bindparam("first"), bindparam("last")),
)
_LATE: Final = select(frames.c.t, frames.c.t_end).where(
    frames.c.slot == bindparam("slot"),
    frames.c.node == bindparam("node"),
    frames.c.page == bindparam("page"),
    frames.c.t >= bindparam("earliest"),
    frames.c.t < bindparam("end"),
    frames.c.t_end >= bindparam("start"),
)


def find_unbuilt(connection: Connection, channel: Channel, within: Range) -> list[Range]:
    """The ranges in which samples must be read instead of tiles, UTC ns.

    Args:
        connection: In a read transaction.
        channel: With ``node``, ``patch``, ``grain`` and ``built``.
        within: A range, UTC ns.
    """
    built, bits = channel["built"], channel["grain"] + PATCH_CHUNK
    if built is None:
        return [within]
    key = Place(channel["node"], channel["patch"]).key
    numbers = {"first": within[0] >> bits, "last": within[1] >> bits}
    chunks = set(connection.execute(_STALE, key | numbers).scalars())
    end = min(built, within[1])
    if within[0] < end:
        chunks |= _late_chunks(connection, channel, (within[0], end), bits)
    opened = [(chunk << bits, (chunk + 1) << bits) for chunk in chunks]
    clipped = ((max(a, within[0]), min(b, within[1])) for a, b in [*opened, (built, MOST_INSTANT)])
    return merged(clipped)


def _late_chunks(connection: Connection, channel: Channel, within: Range, bits: int) -> set[int]:
    """Chunks with samples of frames that are not compacted."""
    longest: dict[int, int] = {}
    for place in find_patch_pages(connection, channel["node"], channel["patch"]):
        if place.totals["frames"]:
            longest[place.page] = max(place.totals["longest"], longest.get(place.page, 0))
    found: set[int] = set()
    key: dict[str, Any] = {"slot": slot_of(channel["node"]), "node": channel["node"]}
    key |= {"start": within[0], "end": within[1]}
    for page, span in longest.items():
        here = key | {"page": page, "earliest": before(within[0], span)}
        for t, t_end in connection.execute(_LATE, here):
            first, last = max(t, within[0]), min(t_end, within[1] - 1)
            found.update(range(first >> bits, (last >> bits) + 1))
    return found


def read_tiles(
    connection: Connection, channel: Channel, level: int, ranges: list[Range]
) -> Aggregates:
    """The tiles of a column of a level in some ranges of numbers; stale ones included.

    Compacted rows are read instead of damaged chunks.

    Args:
        connection: In a read transaction.
        channel: The channel.
        level: One of the patch's levels.
        ranges: Sorted and disjoint.

    Raises:
        UnknownDescriptionError: A description is damaged in the store.
    """
    node, taxel = channel["node"], channel["channel"].partition(".")[0]
    parts: list[tuple[PackedAggregates, int]] = []
    for chunk in _read_chunks(connection, Place(node, channel["patch"]), level, ranges):
        taxels = taxels_of(connection, node, chunk)
        if taxel in taxels:
            parts.append((chunk, taxels.index(taxel)))
    return _inside(read_columns(parts), level, ranges) if parts else EMPTY


def taxels_of(connection: Connection, node: str, chunk: PackedAggregates) -> tuple[str, ...]:
    """The taxel of each column of a chunk.

    Raises:
        UnknownDescriptionError: A description is damaged in the store.
        MessageError: The chunk has other columns.
    """
    taxels = united(find_patch(connection, node, name).taxels for name in chunk.names)
    if len(taxels) != chunk.kind.size:
        raise MessageError(f"tiles of {node} have {chunk.kind.size} columns, not {len(taxels)}")
    return taxels


def fold_chunks(
    connection: Connection, place: Place, level: int, numbers: Iterable[int]
) -> dict[int, ColumnAggregates | None]:
    """Make chunks of compacted rows; ``None`` where there are no samples.

    Chunks that follow each other are made at once: a row is longer than a chunk, and is read once.

    Raises:
        UnknownDescriptionError: A description is damaged in the store.
    """
    chunks: dict[int, ColumnAggregates | None] = dict.fromkeys(numbers)
    bits = level + PATCH_CHUNK
    for first, end in merged((number, number + 1) for number in chunks):
        buckets = Buckets(first << bits, 1 << level, (end - first) << PATCH_CHUNK)
        # Rows are found by the times of their samples, skews included.
        runs = read_compacted(connection, *place, buckets.window)
        if not runs:
            continue
        names = {run.patch for run in runs}
        patches = {name: find_patch(connection, place.node, name) for name in names}
        folded = fold_runs(runs, patches, buckets)
        own = folded.pieces.first >> bits
        for number in np.unique(own).tolist():
            chunks[number] = folded.chosen(own == number)
    return chunks


def read_chunk(
    connection: Connection, place: Place, level: int, number: int, row: tuple[bytes, bytes]
) -> PackedAggregates | None:
    """A chunk; a damaged one is made anew of compacted rows.

    Args:
        connection: In a transaction.
        place: The patch.
        level: The chunk's level.
        number: Its number.
        row: Its columns ``data`` and ``digest``.

    Returns:
        The chunk; ``None`` if it is damaged and has no samples.

    Raises:
        UnknownDescriptionError: A description is damaged in the store.
    """
    data, digest = row
    if is_intact_tile(data, digest, (*place, level, number)):
        return unpack(data)
    folded = fold_chunks(connection, place, level, [number])[number]
    return None if folded is None else unpack(pack(folded))


def _read_chunks(
    connection: Connection, place: Place, level: int, ranges: list[Range]
) -> Iterator[PackedAggregates]:
    """The chunks of a level that hold some tiles, in order."""
    for first, end in coarsened(ranges, PATCH_CHUNK):
        key = place.key | {"level": level, "first": first, "last": end - 1}
        for number, data, digest in connection.execute(_TILES, key).all():
            chunk = read_chunk(connection, place, level, number, (data, digest))
            if chunk is not None:
                yield chunk


def _inside(pieces: Aggregates, level: int, ranges: list[Range]) -> Aggregates:
    """The entries whose tiles lie in some ranges."""
    ends = np.array(ranges, np.int64).ravel()
    places = np.searchsorted(pieces.first >> level, ends).reshape(-1, 2).tolist()
    if len(places) == 1:
        return pieces[slice(*places[0])]
    return pieces[np.concatenate([np.arange(*place) for place in places])]
