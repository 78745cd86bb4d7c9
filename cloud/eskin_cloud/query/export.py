"""Export all samples of channels in a window, in parts, resumable after any block.

The only state between two parts is a position in the order of blocks, so that an export of any
length takes constant memory, and no transaction stays open while a slow client reads.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import chain, repeat
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
from sqlalchemy import and_, case, or_, select, tuple_

from eskin.interval import Interval
from eskin.tube import Tube
from eskin.wire.messages import Block, Position
from eskin.wire.messages.compacted_block import Pack
from eskin.wire.messages.compression import decompress
from eskin_cloud.store.damage import DamagedRowError, RowHeader, is_intact
from eskin_cloud.store.read.block_index import count_samples, overlaps
from eskin_cloud.store.read.patch_columns import is_column, read_column, split_column
from eskin_cloud.store.read.window import Window, before, clip
from eskin_cloud.store.schema.tables import blocks, channels

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence
    from contextlib import AbstractContextManager

    from sqlalchemy import ColumnElement, Connection, Select

    from eskin_cloud.store.read.lookup import Channel
    from eskin_cloud.store.read.patch_columns import ColumnRun

_AT_ONCE: Final = 128
"""Blocks of a part: at most 128,000 samples."""
_ROWS: Final = 4096
"""Rows that are counted at once."""


class ExportPosition(NamedTuple):
    """A block's position in an export: channel by channel, each in order of time.

    Attributes:
        channel: Index of the channel in the query.
        t: Middle of its first sample's time, UTC ns.
        boot: Its node's boot.
        sequence: Its sequence number.
    """

    channel: int
    t: int
    boot: int
    sequence: int


def sequence_of(position: Position) -> int:
    """A block's sequence number."""
    return position.sequence


@dataclass(frozen=True, slots=True)
class ExportChannel:
    """A channel to export, and where its blocks are read.

    Attributes:
        channel: The channel's row.
        open: Opens a read transaction, for one part.
        number: Returns the exported sequence number of a block.
    """

    channel: Channel
    open: Callable[[], AbstractContextManager[Connection]]
    number: Callable[[Position], int] = sequence_of


class DamagedBlock(NamedTuple):
    """A damaged block: the times of its samples, with unbounded values."""

    position: Position
    tube: Tube


class FrameRun(NamedTuple):
    """Samples of one channel from one frame."""

    position: Position
    tube: Tube


class ExportPart(NamedTuple):
    """Consecutive blocks of one channel, or what frames hold of it."""

    channel: Channel
    blocks: Sequence[Block | DamagedBlock | FrameRun]
    number: Callable[[Position], int]


@dataclass(frozen=True, slots=True)
class Export:
    """An export.

    Attributes:
        sources: The channels, in the order of the answer.
        window: The window.
        after: The last block of an earlier part; ``None`` for the beginning.
    """

    sources: Sequence[ExportChannel]
    window: Window
    after: ExportPosition | None

    def samples(self) -> int:
        """The number of samples in the window, of all channels."""
        total = 0
        for source in self.sources:
            with source.open() as connection:
                total += count_samples(
                    connection, _as_it_is(connection, source.channel), self.window
                )
        return total

    def find_end(self, limit: int) -> ExportPosition | None:
        """The block that completes ``limit`` samples; ``None`` if no block follows it.

        A block is never cut: the last one may exceed the limit.
        """
        left = limit
        last: ExportPosition | None = None
        for index, begin in self._marks():
            for found in chain.from_iterable(self._pages(index, begin, None, whole=False)):
                if left <= 0:
                    return last
                first, final = clip(found.place[0], found.dt, found.n, self.window)
                left -= max(0, final - first + 1)
                last = ExportPosition(index, *found.place)
        return None

    def read(self, until: ExportPosition | None) -> Iterator[ExportPart]:
        """Decode blocks in order, up to and including ``until``.

        The samples of a damaged block are unbounded.

        Raises:
            DamagedRowError: The times of a damaged block are damaged, too.
        """
        for index, begin in self._marks():
            if until is not None and index > until.channel:
                return
            for page in self._pages(index, begin, until, whole=True):
                for k in range(0, len(page), _AT_ONCE):
                    source = self.sources[index]
                    decoded = [
                        _decoded(found, source.channel["unit"]) for found in page[k : k + _AT_ONCE]
                    ]
                    yield ExportPart(source.channel, decoded, source.number)

    def _pages(
        self, index: int, after: ExportPosition | None, until: ExportPosition | None, *, whole: bool
    ) -> Iterator[Sequence[_StoredBlock | _StoredRun]]:
        """A channel's blocks in order, in pages; ``whole`` with their bytes.

        Each page starts after the last block of the one before, whatever was compacted meanwhile.
        """
        if is_column(self.sources[index].channel):
            yield from self._runs(index, after, _later(until, index))
            return
        most = _AT_ONCE if whole else _ROWS
        while True:
            with self.sources[index].open() as connection:
                query = self._ordered(connection, index, after, until, whole=whole)
                rows = connection.execute(query.limit(most)).all()
            full = len(rows) == most
            # Blocks of packs before the last row may lie among those after it.
            last = ExportPosition(index, *rows[-1][:3]) if full else _later(until, index)
            page = self._between(rows, after, min(last, _later(until, index)), whole=whole)
            if page:
                yield page
                after = ExportPosition(index, *page[-1].place)
            elif full:
                most *= 2
            if not full:
                return

    def _runs(
        self, index: int, after: ExportPosition | None, last: ExportPosition
    ) -> Iterator[Sequence[_StoredRun]]:
        """As `_pages`, of a channel of frames."""
        source = self.sources[index]
        begin = self.window.start if after is None else max(after.t, self.window.start)
        at = begin
        while at < self.window.end and (at == begin or at <= last.t):
            with source.open() as connection:
                rest = Window(at, self.window.end)
                part = next(split_column(connection, source.channel, rest))
                runs = read_column(connection, source.channel, part)
            page = [
                _StoredRun((run.t, run.boot, run.sequence), run.lo.size, run.dt, run)
                for run in runs
                # One that began before was in the part before.
                if at == begin or run.t >= at
            ]
            page = [
                run
                for run in page
                if (after is None or run.place > after[1:]) and run.place <= last[1:]
            ]
            if page:
                yield page
            at = part.end

    def _between(
        self,
        rows: Sequence[Any],
        after: ExportPosition | None,
        last: ExportPosition,
        *,
        whole: bool,
    ) -> list[_StoredBlock]:
        """The blocks of rows between two positions, in the window."""
        found = (block for row in rows for block in _blocks(row, whole=whole))
        chosen = [
            block
            for block in found
            if (after is None or block.place > after[1:])
            and block.place <= last[1:]
            and block.place[0] < self.window.end
            and block.place[0] + (block.n - 1) * block.dt >= self.window.start
        ]
        return sorted(chosen)

    def _marks(self) -> Iterator[tuple[int, ExportPosition | None]]:
        """The remaining channels, each with the block after which it starts."""
        first = 0 if self.after is None else self.after.channel
        for index in range(first, len(self.sources)):
            yield index, self.after if index == first else None

    def _ordered(
        self,
        connection: Connection,
        index: int,
        after: ExportPosition | None,
        until: ExportPosition | None,
        *,
        whole: bool,
    ) -> Select[Any]:
        b = blocks.c
        key = tuple_(b.t, b.boot, b.sequence)
        channel = _as_it_is(connection, self.sources[index].channel)
        where: list[ColumnElement[bool]] = [overlaps(channel, self.window)]
        if after is not None:
            reaching = and_(b.packed.is_not(None), b.t_end >= after.t)
            where += [b.t >= before(after.t, channel["longest"]), or_(key > after[1:], reaching)]
        if until is not None and until.channel == index:
            where += [b.t <= until.t, key <= until[1:]]
        data = b.data if whole else case((b.packed.is_not(None), b.data), else_=None)
        head = (b[name] for name in RowHeader._fields)
        query = select(b.t, b.boot, b.sequence, b.n, b.dt, b.packed, data, b.head, *head)
        return query.where(*where).order_by(b.t, b.boot, b.sequence)


class _StoredBlock(NamedTuple):
    """A block: its key (time, boot, sequence), samples and bytes; of a damaged row the header."""

    place: tuple[int, int, int]
    n: int
    dt: int
    data: bytes
    damaged: RowHeader | None = None


class _StoredRun(NamedTuple):
    """What a frame holds of a channel: its key (time, boot, sequence), and samples."""

    place: tuple[int, int, int]
    n: int
    dt: int
    run: ColumnRun


def _blocks(row: Sequence[Any], *, whole: bool) -> Iterable[_StoredBlock]:
    """The blocks of a row of `Export._ordered`; a damaged pack is one block.

    Raises:
        DamagedRowError: The row's header is damaged.
    """
    t, boot, sequence, n, dt, packed, data, own, *head = row
    header = RowHeader(*head)
    if not is_intact(header, own):
        raise DamagedRowError(header.place)
    if data is not None and not is_intact(header, own, data):
        return [_StoredBlock((t, boot, sequence), n, dt, b"", header)]
    if packed is None:
        return [_StoredBlock((t, boot, sequence), n, dt, data)]
    pack = Pack.read(data)
    counts, sequences = pack.n.tolist(), pack.column("sequence").tolist()
    times = (t + dt * (np.cumsum(pack.n) - pack.n)).tolist()
    places = zip(times, repeat(boot), sequences, strict=False)
    each = [kept.data for kept in pack.blocks()] if whole else repeat(b"", packed)
    return map(_StoredBlock, places, counts, repeat(dt), each)


def _decoded(found: _StoredBlock | _StoredRun, unit: str) -> Block | DamagedBlock | FrameRun:
    if isinstance(found, _StoredRun):
        run = found.run
        time = run.t - run.error, run.t + run.error
        tube = Tube(time, run.dt, Interval(run.lo, run.hi), unit, run.coverage)
        return FrameRun(Position(run.boot, run.sequence), tube)
    if found.damaged is None:
        return Block.decode(decompress(found.data))
    head = found.damaged
    unknown = Interval(np.full(head.n, -np.inf), np.full(head.n, np.inf))
    time = head.t - head.error, head.t + head.error
    tube = Tube(time, head.dt, unknown, unit, head.coverage)
    return DamagedBlock(Position(head.boot, head.sequence), tube)


def _later(until: ExportPosition | None, index: int) -> ExportPosition:
    """The last position of a channel to export."""
    if until is not None and until.channel == index:
        return until
    return ExportPosition(index, 2**63, 0, 0)


def _as_it_is(connection: Connection, channel: Channel) -> Channel:
    """The channel's current row: blocks may have become longer meanwhile."""
    if is_column(channel):
        return channel
    here = (channels.c.node == channel["node"]) & (channels.c.channel == channel["channel"])
    return connection.execute(select(channels).where(here)).mappings().one()
