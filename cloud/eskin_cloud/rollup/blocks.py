"""Read blocks as aggregates: of single samples, of buckets, or of blocks' bounds."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from operator import le
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
from sqlalchemy import and_, bindparam, not_, select

from eskin.wire.messages.compacted_block import Pack, is_pack
from eskin.wire.messages.stored_bounds import read_bounds
from eskin.wire.timestamp import MOST_MOMENT
from eskin_cloud.rollup.aggregates import EMPTY, Aggregates, concatenated
from eskin_cloud.store.damage import RowHeader, intact_headers, is_intact
from eskin_cloud.store.read.block_index import (
    HEADER_COLUMNS,
    OVERLAPS,
    exceeds,
    overlaps,
    window_parameters,
)
from eskin_cloud.store.read.patch_columns import is_column, read_column, split_column
from eskin_cloud.store.read.window import Window, clip
from eskin_cloud.store.schema.tables import blocks

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sqlalchemy import Connection, RowMapping

    from eskin.interval import Floats
    from eskin_cloud.rollup.aggregates import Integers
    from eskin_cloud.store.read.lookup import Channel

DECODED: Final = tuple(
    blocks.c[name]
    for name in (
        *("t", "dt", "n", "error", "coverage", "data"),
        *("head", *RowHeader._fields),
    )
)
"""Columns that `decode` reads: a block's samples, its digests and its header."""
_IN_ORDER: Final = select(*DECODED).order_by(blocks.c.t, blocks.c.boot, blocks.c.sequence)
_TOUCHING: Final = _IN_ORDER.where(OVERLAPS)
_COUNTS: Final = select(blocks.c.n).where(OVERLAPS).limit(bindparam("most"))
_FEW: Final = 600
"""Up to so many blocks are decoded in any case, …"""
_FEW_SAMPLES: Final = 300_000
"""… unless they hold more samples than this, as packs may."""


@dataclass(frozen=True, slots=True)
class Buckets:
    """Consecutive buckets of equal width.

    Attributes:
        start: Start of the first, UTC ns.
        width: Width of each, ns.
        count: Number of buckets.
    """

    start: int
    width: int
    count: int

    def of(self, moments: Integers) -> Integers:
        """The numbers of the buckets that hold some times."""
        return (moments - self.start) // self.width

    @property
    def window(self) -> Window:
        """The window of all buckets, limited to 64-bit times."""
        return Window(self.start, min(self.start + self.width * self.count, MOST_MOMENT))


def decode(rows: Sequence[Any], window: Window) -> Aggregates:
    """One entry for each sample in a window.

    Args:
        rows: Columns ``DECODED`` of blocks, in order of time, boot and sequence.
        window: The window.
    """
    rows = _holding(rows, window)
    return _apart(*_opened(rows), window) if rows else EMPTY


def fold(rows: Sequence[Any], window: Window, buckets: Buckets) -> Aggregates:
    """One entry for each bucket with samples in a window.

    Args:
        rows: As in `decode`.
        window: A window within the buckets.
        buckets: The buckets.
    """
    rows = _holding(rows, window)
    return _folded(*_opened(rows), window, buckets) if rows else EMPTY


def _folded(
    heads: Sequence[_Head], bounds: tuple[Floats, Floats], window: Window, buckets: Buckets
) -> Aggregates:
    if not heads:
        return EMPTY
    if any(after.t < head.t + head.dt * (head.n - 1) for head, after in pairwise(heads)):
        samples = _apart(heads, bounds, window)  # blocks overlap
        return samples.grouped(buckets.of(samples.first))
    runs, place = [], 0
    for t, dt, n, error, _ in heads:
        first, last = clip(t, dt, n, window)
        runs.append((t + dt * first, dt, last - first + 1, place + first, error))
        place += n
    coverage = np.array([head.coverage for head in heads])
    grid = buckets.start, buckets.width
    return Aggregates.of_samples(bounds, np.array(runs), coverage, grid, buckets.count)


def _holding(rows: Sequence[Any], window: Window) -> list[Any]:
    """The heads and bytes of those of whose samples any lies in a window, and that are sound.

    Slow ones may reach over it without; what a damaged one held is a gap.
    """
    return [
        row[:6]
        for row in rows
        if le(*clip(row[0], row[1], row[2], window))
        and is_intact(RowHeader(*row[7:]), row[6], row[5])
    ]


class _Head(NamedTuple):
    """A block without its samples."""

    t: int
    dt: int
    n: int
    error: int
    coverage: float


def _opened(rows: Sequence[Any]) -> tuple[list[_Head], tuple[Floats, Floats]]:
    """Headers of all blocks in some rows, and the bounds of their samples."""
    heads, found = [], []
    for *head, data in rows:
        if not is_pack(data):
            heads.append(_Head(*head))
            found.append(read_bounds(data))
            continue
        pack, (_, dt, _, _, coverage) = Pack.read(data), head
        each = zip(pack.first_moments.tolist(), pack.n.tolist(), pack.errors.tolist(), strict=True)
        heads += [_Head(t, dt, n, error, coverage) for t, n, error in each]
        found.append(pack.bounds())
    lo, hi = (np.concatenate([each[side] for each in found]) for side in (0, 1))
    return heads, (lo, hi)


def _opened_column(
    connection: Connection, channel: Channel, window: Window
) -> tuple[list[_Head], tuple[Floats, Floats]]:
    """As `_opened`, of a channel of frames."""
    runs = read_column(connection, channel, window)
    heads = [_Head(run.t, run.dt, run.lo.size, run.error, run.coverage) for run in runs]
    if not runs:
        return heads, (np.empty(0), np.empty(0))
    return heads, (
        np.concatenate([run.lo for run in runs]),
        np.concatenate([run.hi for run in runs]),
    )


def _apart(heads: Sequence[_Head], bounds: tuple[Floats, Floats], window: Window) -> Aggregates:
    if not heads:
        return EMPTY
    first, period, n, errors, coverages = zip(*heads, strict=True)
    begun, dt, error = (np.repeat(np.array(e, np.int64), n) for e in (first, period, errors))
    number = np.concatenate([np.arange(each, dtype=np.int64) for each in n])
    t = begun + dt * number
    none = np.zeros(t.size, np.int64)
    coverage = np.repeat(np.array(coverages), n)
    pieces = Aggregates(t, t, none + 1, none, dt, none, error, *bounds, *bounds, coverage)
    order = np.flatnonzero((t >= window.start) & (t < window.end))
    if np.any(np.diff(t[order]) < 0):
        order = order[np.lexsort((begun[order], t[order]))]
    return pieces[order]


def read_samples(connection: Connection, channel: Channel, window: Window) -> Aggregates:
    """One entry for each sample in a window."""
    if is_column(channel):
        return _apart(*_opened_column(connection, channel, window), window)
    return decode(_touching(connection, channel, window), window)


def read_few(
    connection: Connection, channel: Channel, window: Window, most: int
) -> Aggregates | None:
    """One entry for each sample in a window; ``None`` if there are more than ``most``."""
    if not is_column(channel):
        if exceeds(connection, channel, window, most):
            return None
        return read_samples(connection, channel, window)
    found, count = [], 0
    for part in split_column(connection, channel, window):
        found.append(read_samples(connection, channel, part))
        count += len(found[-1])
        if count > most:
            return None
    return concatenated(found)


def read_folded(
    connection: Connection, channel: Channel, window: Window, buckets: Buckets
) -> Aggregates:
    """One entry for each bucket with samples in a window."""
    if is_column(channel):
        heads, bounds = _opened_column(connection, channel, window)
        return _folded(heads, bounds, window, buckets)
    return fold(_touching(connection, channel, window), window, buckets)


def read_buckets(
    connection: Connection, channel: Channel, window: Window, buckets: Buckets
) -> Aggregates:
    """Aggregates of a window's samples, none across a bucket's end.

    If there are many blocks, those within one bucket are aggregated by their bounds, which then
    enclose their sums, too.
    """
    if is_column(channel):
        parts = split_column(connection, channel, window)
        folded = concatenated([read_folded(connection, channel, p, buckets) for p in parts])
        return folded.grouped(buckets.of(folded.first))
    if _are_few(connection, channel, window):
        return read_folded(connection, channel, window, buckets)
    b, here = blocks.c, overlaps(channel, window)
    bucket = (b.t - buckets.start) // buckets.width
    within = and_(b.t >= window.start, b.t_end < window.end)
    alone = and_(within, bucket == (b.t_end - buckets.start) // buckets.width)
    query = _IN_ORDER.where(here, not_(alone))
    parted = fold(connection.execute(query).all(), window, buckets)
    headers = select(*HEADER_COLUMNS).where(here, alone).order_by(b.t, b.boot, b.sequence)
    whole = of_headers(list(intact_headers(connection.execute(headers).mappings())))
    return concatenated([whole.grouped(buckets.of(whole.first)), parted])


def of_headers(rows: Sequence[RowMapping]) -> Aggregates:
    """One entry for each block, by its bounds.

    Args:
        rows: Headers of blocks, in order of time.
    """
    if not rows:
        return EMPTY
    t, t_end, n, dt, error = (
        np.array([row[name] for row in rows], np.int64)
        for name in ("t", "t_end", "n", "dt", "error")
    )
    lo, hi, coverage = (
        np.array([row[name] for row in rows], np.float64) for name in ("lo", "hi", "coverage")
    )
    sum_lo, sum_hi = np.nextafter(n * lo, -np.inf), np.nextafter(n * hi, np.inf)
    none = np.zeros(t.size, np.int64)
    return Aggregates(t, t_end, n, none, dt, t_end - t, error, lo, hi, sum_lo, sum_hi, coverage)


def _are_few(connection: Connection, channel: Channel, window: Window) -> bool:
    n = (
        connection.execute(_COUNTS, window_parameters(channel, window) | {"most": _FEW + 1})
        .scalars()
        .all()
    )
    return len(n) <= _FEW and sum(n) <= _FEW_SAMPLES


def _touching(connection: Connection, channel: Channel, window: Window) -> Sequence[Any]:
    return connection.execute(_TOUCHING, window_parameters(channel, window)).all()
