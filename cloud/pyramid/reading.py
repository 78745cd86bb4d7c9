"""Reading the pyramid: a stretch of time from its tiles, from blocks where they are not good."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
from sqlalchemy import select

from cloud.pyramid.blocks import Buckets, read_buckets
from cloud.pyramid.pieces import EMPTY, Pieces, concatenated
from cloud.pyramid.ranges import Range, coarsened, merged, refined, without
from cloud.query.window import Window
from cloud.store.grid import CHUNK, STEP
from cloud.store.tiles import stale, tiles

if TYPE_CHECKING:
    from sqlalchemy import Connection, RowMapping

    from cloud.pyramid.pieces import Integers

_FOREVER: Final = 2**63 - 1


@dataclass(frozen=True, slots=True)
class Stretch:
    """Neighbouring tiles of a level, from ``first`` up to, and without, ``end``."""

    level: int
    first: int
    end: int

    @property
    def range(self) -> Range:
        """When they are, UTC ns, as far as there is time."""
        return self.first << self.level, min(self.end << self.level, _FOREVER)


def read_stretch(connection: Connection, channel: RowMapping, stretch: Stretch) -> Pieces:
    """Exact pieces of all samples in a stretch, none of which reaches over a tile's end.

    Tiles over what changed since they were made are left alone, for those below them; on the lowest
    chunks, blocks are read.

    Args:
        connection: Reads one state of the store.
        channel: The channel's row.
        stretch: Of the channel's lowest level, or a whole number of steps above.
    """
    opened = find_open(connection, channel, stretch.range)
    region, found = [(stretch.first, stretch.end)], []
    for level in range(stretch.level, channel["grain"] - 1, -STEP):
        holes = coarsened(opened, level)
        found.append(read_tiles(connection, channel, level, without(region, holes)))
        if not holes or level <= channel["grain"] + CHUNK:
            break
        region = refined(holes, STEP)
    count = stretch.end - stretch.first
    buckets = Buckets(stretch.first << stretch.level, 1 << stretch.level, count)
    found += [read_buckets(connection, channel, Window(*each), buckets) for each in opened]
    return concatenated(found)


def find_open(connection: Connection, channel: RowMapping, within: Range) -> list[Range]:
    """When blocks must be read in the place of tiles, UTC ns."""
    built, bits = channel["built"], channel["grain"] + CHUNK
    if built is None:
        return [within]
    s = stale.c
    query = select(s.chunk).where(
        s.node == channel["node"],
        s.channel == channel["channel"],
        s.chunk >= within[0] >> bits,
        s.chunk <= within[1] >> bits,
    )
    opened = [(chunk << bits, (chunk + 1) << bits) for chunk in connection.execute(query).scalars()]
    clipped = ((max(a, within[0]), min(b, within[1])) for a, b in [*opened, (built, _FOREVER)])
    return merged(clipped)


def read_tiles(
    connection: Connection, channel: RowMapping, level: int, ranges: list[Range]
) -> Pieces:
    """The tiles of a level whose numbers lie in some ranges, as they stand."""
    t = tiles.c
    chunks = [n for first, end in coarsened(ranges, CHUNK) for n in range(first, end)]
    if not chunks:
        return EMPTY
    here = (t.node == channel["node"]) & (t.channel == channel["channel"]) & (t.level == level)
    wanted = t.chunk.between(chunks[0], chunks[-1])
    if chunks[-1] - chunks[0] >= len(chunks):
        wanted = t.chunk.in_(chunks)
    query = select(t.data).where(here, wanted).order_by(t.chunk)
    found = Pieces.unpack(connection.execute(query).scalars().all())
    return found[_inside(found.first >> level, ranges)]


def _inside(numbers: Integers, ranges: list[Range]) -> Integers:
    edges = np.array(ranges, np.int64).ravel()
    return np.flatnonzero(np.searchsorted(edges, numbers, side="right") % 2)
