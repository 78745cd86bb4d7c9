"""Blocks as pieces: by their samples, or by their bounds where nothing finer is asked."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import chain, repeat
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from sqlalchemy import and_, func, not_, select

from cloud.pyramid.pieces import EMPTY, Pieces, concatenated
from cloud.query.span import touching
from cloud.query.window import Window
from cloud.store.schema import blocks
from eskin.messages.pack import Pack, is_pack
from eskin.messages.stored import read_bounds

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from sqlalchemy import ColumnElement, Connection, RowMapping

    from cloud.pyramid.pieces import Integers

DECODED: Final = tuple(blocks.c[name] for name in ("t", "dt", "n", "error", "coverage", "data"))
"""What of a block's row tells of its samples."""
_AT_ONCE: Final = 256
_FEW: Final = 600
"""So many blocks are decoded, whatever is asked of them, …"""
_FEW_SAMPLES: Final = 300_000
"""… if they hold no more than this, as packs might."""


@dataclass(frozen=True, slots=True)
class Buckets:
    """Equal stretches of time that follow each other.

    Attributes:
        start: Where the first begins, UTC ns.
        width: Of each, in ns.
        count: How many.
    """

    start: int
    width: int
    count: int

    def of(self, moments: Integers) -> Integers:
        """The numbers of the buckets in which moments lie."""
        return (moments - self.start) // self.width

    @property
    def window(self) -> Window:
        """All that they span, as far as there is time."""
        return Window(self.start, min(self.start + self.width * self.count, 2**63 - 1))


def decode(rows: Sequence[Any], window: Window) -> Pieces:
    """One piece for each sample in a window.

    Args:
        rows: Blocks by the columns ``DECODED``, in order of time, then of boot and sequence.
        window: Which samples.
    """
    if not rows:
        return EMPTY
    found = [read_bounds(data) for *_, data in rows]
    lo, hi = (np.concatenate([each[side] for each in found]) for side in (0, 1))
    columns = zip(*chain.from_iterable(map(_blocks, rows)), strict=True)
    first, period, n, errors, coverages = columns
    begun, dt, error = (np.repeat(np.array(e, np.int64), n) for e in (first, period, errors))
    number = np.concatenate([np.arange(each, dtype=np.int64) for each in n])
    t = begun + dt * number
    none = np.zeros(t.size, np.int64)
    coverage = np.repeat(np.array(coverages), n)
    pieces = Pieces(t, t, none + 1, none, dt, none, error, lo, hi, lo, hi, coverage)
    order = np.flatnonzero((t >= window.start) & (t < window.end))
    if np.any(np.diff(t[order]) < 0):
        order = order[np.lexsort((begun[order], t[order]))]
    return pieces[order]


def _blocks(row: Sequence[Any]) -> Iterable[tuple[Any, ...]]:
    """What a row's columns but ``data`` say of each of its blocks."""
    *block, data = row
    if not is_pack(data):
        return [tuple(block)]
    pack = Pack.read(data)
    first = (pack.column("t_lo") + pack.column("t_hi")) // 2
    return zip(first, repeat(block[1]), pack.n, pack.errors, repeat(block[4]), strict=False)


def read_samples(connection: Connection, channel: RowMapping, window: Window) -> Pieces:
    """One piece for each sample in a window."""
    return _decoded(connection, touching(channel, window), window)


def read_buckets(
    connection: Connection, channel: RowMapping, window: Window, buckets: Buckets
) -> Pieces:
    """Pieces of the blocks in a window, none of which reaches over a bucket's end.

    Where blocks are many, those that lie in one bucket as a whole are told by their bounds: then
    their sums are enclosed by theirs, and gaps between them are not told.
    """
    here = touching(channel, window)
    if _are_few(connection, here):
        samples = read_samples(connection, channel, window)
        return samples.grouped(buckets.of(samples.first))
    b = blocks.c
    bucket = (b.t - buckets.start) // buckets.width
    within = and_(b.t >= window.start, b.t_end < window.end)
    alone = and_(within, bucket == (b.t_end - buckets.start) // buckets.width)
    parted = _decoded(connection, and_(here, not_(alone)), window)
    bounds = select(
        func.min(b.t), func.max(b.t_end), func.sum(b.n), func.max(b.dt), func.max(b.error),
        func.min(b.lo), func.max(b.hi), func.min(b.coverage),
    )  # fmt: skip
    rows = connection.execute(bounds.where(here, alone).group_by(bucket)).all()
    return concatenated([_bounded(rows), parted.grouped(buckets.of(parted.first))])


def _bounded(rows: Sequence[Any]) -> Pieces:
    if not rows:
        return EMPTY
    columns = list(zip(*sorted(rows), strict=True))
    t, t_end, n, dt, error = (np.array([*map(int, each)], np.int64) for each in columns[:5])
    lo, hi, coverage = (np.array(each, np.float64) for each in columns[5:])
    sum_lo, sum_hi = np.nextafter(n * lo, -np.inf), np.nextafter(n * hi, np.inf)
    none = np.zeros(n.size, np.int64)
    return Pieces(t, t_end, n, none, dt, t_end - t, error, lo, hi, sum_lo, sum_hi, coverage)


def _are_few(connection: Connection, here: ColumnElement[bool]) -> bool:
    n = connection.execute(select(blocks.c.n).where(here).limit(_FEW + 1)).scalars().all()
    return len(n) <= _FEW and sum(n) <= _FEW_SAMPLES


def _decoded(connection: Connection, where: ColumnElement[bool], window: Window) -> Pieces:
    b = blocks.c
    query = select(*DECODED).where(where).order_by(b.t, b.boot, b.sequence)
    rows = connection.execute(query)
    return concatenated([decode(part, window) for part in rows.partitions(_AT_ONCE)])
