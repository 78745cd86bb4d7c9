"""Writing chunks of the lowest level, and what stands on them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from sqlalchemy import delete, insert, select

from eskin.runtime.digest import digest
from eskin.wire.timestamp import MOST_MOMENT
from eskin_cloud.rollup.aggregates import Aggregates, concatenated
from eskin_cloud.rollup.blocks import Buckets, read_folded
from eskin_cloud.store.damage import is_sound_tile
from eskin_cloud.store.read.lookup import find_channel
from eskin_cloud.store.read.window import Window
from eskin_cloud.store.sample_grid import CHUNK, STEP, TOP
from eskin_cloud.store.schema.tile_tables import tiles

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from sqlalchemy import ColumnElement, Connection


def write_levels(
    connection: Connection, place: tuple[str, str], grain: int, chunks: Mapping[int, Aggregates]
) -> None:
    """Put chunks of a channel's lowest level in the place of those before, and so on each above.

    Args:
        connection: The writing thread's, in a transaction.
        place: Node and channel.
        grain: The lowest level.
        chunks: By number.
    """
    _replace(connection, place, grain, chunks)
    for level in range(grain + STEP, TOP + 1, STEP):
        chunks = _above(connection, place, level, chunks)
        _replace(connection, place, level, chunks)


def _above(
    connection: Connection, place: tuple[str, str], level: int, below: Mapping[int, Aggregates]
) -> dict[int, Aggregates]:
    """The chunks of a level over some of the level below."""
    numbers = sorted({chunk >> STEP for chunk in below})
    query = select(tiles.c.chunk, tiles.c.data, tiles.c.digest)
    query = query.where(_at(place, level, numbers))
    standing = connection.execute(query).all()
    changed = np.array(sorted(below), np.int64)
    parts: dict[int, list[Aggregates]] = {number: [] for number in numbers}
    for number, data, own in standing:
        sound = is_sound_tile(data, own, (*place, level, number))
        old = Aggregates.unpack([data]) if sound else _anew(connection, place, level, number)
        beneath = old.first >> (level - STEP + CHUNK)
        parts[number].append(old[~np.isin(beneath, changed)])
    for chunk, pieces in below.items():
        parts[chunk >> STEP].append(pieces.grouped(pieces.first >> level))
    return {number: concatenated(each) for number, each in parts.items()}


def _anew(connection: Connection, place: tuple[str, str], level: int, number: int) -> Aggregates:
    """A chunk from its blocks, in the place of one that is damaged."""
    start, end = number << (level + CHUNK), (number + 1) << (level + CHUNK)
    buckets = Buckets(start, 1 << level, 1 << CHUNK)
    channel = find_channel(connection, *place)
    return read_folded(connection, channel, Window(start, min(end, MOST_MOMENT)), buckets)


def _replace(
    connection: Connection, place: tuple[str, str], level: int, chunks: Mapping[int, Aggregates]
) -> None:
    connection.execute(delete(tiles).where(_at(place, level, chunks)))
    key = {"node": place[0], "channel": place[1], "level": level}
    packed = {n: each.pack() for n, each in chunks.items() if len(each)}
    rows = [key | {"chunk": n, "data": d, "digest": digest(d)} for n, d in packed.items()]
    if rows:
        connection.execute(insert(tiles), rows)


def _at(place: tuple[str, str], level: int, chunks: Iterable[int]) -> ColumnElement[bool]:
    t = tiles.c
    here = (t.node == place[0]) & (t.channel == place[1]) & (t.level == level)
    return here & t.chunk.in_(list(chunks))
