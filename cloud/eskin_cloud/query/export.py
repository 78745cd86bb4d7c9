"""Exports: all samples of channels in a window, part by part, resumable behind any block.

Nothing is held between two parts but a place in the order of blocks, so that an export of any
length takes constant memory and no transaction stays open while a slow client reads.
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
from eskin_cloud.store.damage import DamagedRowError, Head, is_sound, is_sound_head
from eskin_cloud.store.read.block_index import before, clip, count, touching
from eskin_cloud.store.schema.tables import blocks, channels

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence
    from contextlib import AbstractContextManager

    from sqlalchemy import ColumnElement, Connection, RowMapping, Select

    from eskin_cloud.store.read.window import Window

_AT_ONCE: Final = 128
"""Blocks in one part: 128,000 samples at most; rows that are read for it."""
_MARKS: Final = 4096
"""Rows that are counted at a time."""


class Mark(NamedTuple):
    """A block's place in an export: channel by channel, each in order of time.

    Attributes:
        channel: Which of the channels, as they were asked for.
        t: Middle of its first moment, UTC ns.
        boot: Of its node.
        sequence: Of that boot.
    """

    channel: int
    t: int
    boot: int
    sequence: int


def sequence_of(position: Position) -> int:
    """A block's sequence number, as its node gave it."""
    return position.sequence


@dataclass(frozen=True, slots=True)
class Source:
    """A channel, and where its blocks are read.

    Attributes:
        channel: The channel's row.
        open: Gives a connection, for one part.
        number: What is told as a block's sequence number.
    """

    channel: RowMapping
    open: Callable[[], AbstractContextManager[Connection]]
    number: Callable[[Position], int] = sequence_of


class Unknown(NamedTuple):
    """A damaged block: when its samples were taken, and nothing else."""

    position: Position
    tube: Tube


class Part(NamedTuple):
    """Some consecutive blocks of one channel."""

    channel: RowMapping
    blocks: Sequence[Block | Unknown]
    number: Callable[[Position], int]


@dataclass(frozen=True, slots=True)
class Export:
    """What is asked for.

    Attributes:
        sources: The channels, in the order of their answer.
        window: When.
        after: The last block that is not wanted any more; ``None`` for all from the beginning.
    """

    sources: Sequence[Source]
    window: Window
    after: Mark | None

    def samples(self) -> int:
        """How many samples lie in the window, in all channels."""
        total = 0
        for source in self.sources:
            with source.open() as connection:
                total += count(connection, _as_it_is(connection, source.channel), self.window)
        return total

    def find_end(self, limit: int) -> Mark | None:
        """The block with which ``limit`` samples are full; ``None`` where there is nothing behind.

        A block is never cut for it: the last one may bring some more.
        """
        left = limit
        last: Mark | None = None
        for index, begin in self._marks():
            for found in chain.from_iterable(self._pages(index, begin, None, whole=False)):
                if left <= 0:
                    return last
                first, final = clip(found.place[0], found.dt, found.n, self.window)
                left -= max(0, final - first + 1)
                last = Mark(index, *found.place)
        return None

    def read(self, until: Mark | None) -> Iterator[Part]:
        """Decode blocks in order, up to and with ``until``.

        Of a damaged block each sample is there, and unbounded.

        Raises:
            DamagedRowError: Nobody can tell when a damaged block's samples were.
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
                    yield Part(source.channel, decoded, source.number)

    def _pages(
        self, index: int, after: Mark | None, until: Mark | None, *, whole: bool
    ) -> Iterator[Sequence[_Found]]:
        """A channel's blocks in order, some at a time; ``whole`` with their bytes.

        Each page goes on behind the last block of the one before, whatever was packed meanwhile.
        """
        most = _AT_ONCE if whole else _MARKS
        while True:
            with self.sources[index].open() as connection:
                query = self._ordered(connection, index, after, until, whole=whole)
                rows = connection.execute(query.limit(most)).all()
            full = len(rows) == most
            # Behind the last row others begin, and blocks of packs before it may lie among them.
            last = Mark(index, *rows[-1][:3]) if full else _later(until, index)
            page = self._between(rows, after, min(last, _later(until, index)), whole=whole)
            if page:
                yield page
                after = Mark(index, *page[-1].place)
            elif full:
                most *= 2
            if not full:
                return

    def _between(
        self, rows: Sequence[Any], after: Mark | None, last: Mark, *, whole: bool
    ) -> list[_Found]:
        """The blocks of rows that lie behind a mark, up to another one, and in the window."""
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

    def _marks(self) -> Iterator[tuple[int, Mark | None]]:
        """The channels that are left, each with the block behind which it begins."""
        first = 0 if self.after is None else self.after.channel
        for index in range(first, len(self.sources)):
            yield index, self.after if index == first else None

    def _ordered(
        self,
        connection: Connection,
        index: int,
        after: Mark | None,
        until: Mark | None,
        *,
        whole: bool,
    ) -> Select[Any]:
        b = blocks.c
        key = tuple_(b.t, b.boot, b.sequence)
        channel = _as_it_is(connection, self.sources[index].channel)
        where: list[ColumnElement[bool]] = [touching(channel, self.window)]
        if after is not None:
            reaching = and_(b.packed.is_not(None), b.t_end >= after.t)
            where += [b.t >= before(after.t, channel["longest"]), or_(key > after[1:], reaching)]
        if until is not None and until.channel == index:
            where += [b.t <= until.t, key <= until[1:]]
        data = b.data if whole else case((b.packed.is_not(None), b.data), else_=None)
        head = (b[name] for name in Head._fields)
        query = select(b.t, b.boot, b.sequence, b.n, b.dt, b.packed, data, b.head, *head)
        return query.where(*where).order_by(b.t, b.boot, b.sequence)


class _Found(NamedTuple):
    """A block: middle of its first moment, boot and sequence; its samples; its bytes.

    Of a damaged row only the columns are known.
    """

    place: tuple[int, int, int]
    n: int
    dt: int
    data: bytes
    damaged: Head | None = None


def _blocks(row: Sequence[Any], *, whole: bool) -> Iterable[_Found]:
    """The blocks of a row, as `Export._ordered` asks for it; a damaged pack is one block.

    Raises:
        DamagedRowError: Nobody can tell when its samples were.
    """
    t, boot, sequence, n, dt, packed, data, own, *head = row
    said = Head(*head)
    if not is_sound_head(said, own):
        raise DamagedRowError(said.place)
    if data is not None and not is_sound(data, said, own):
        return [_Found((t, boot, sequence), n, dt, b"", said)]
    if packed is None:
        return [_Found((t, boot, sequence), n, dt, data)]
    pack = Pack.read(data)
    counts, sequences = pack.n.tolist(), pack.column("sequence").tolist()
    times = (t + dt * (np.cumsum(pack.n) - pack.n)).tolist()
    places = zip(times, repeat(boot), sequences, strict=False)
    each = [kept.data for kept in pack.blocks()] if whole else repeat(b"", packed)
    return map(_Found, places, counts, repeat(dt), each)


def _decoded(found: _Found, unit: str) -> Block | Unknown:
    if found.damaged is None:
        return Block.decode(decompress(found.data))
    head = found.damaged
    unknown = Interval(np.full(head.n, -np.inf), np.full(head.n, np.inf))
    time = head.t - head.error, head.t + head.error
    tube = Tube(time, head.dt, unknown, unit, head.coverage)
    return Unknown(Position(head.boot, head.sequence), tube)


def _later(until: Mark | None, index: int) -> Mark:
    """The last mark of a channel that is wanted."""
    if until is not None and until.channel == index:
        return until
    return Mark(index, 2**63, 0, 0)


def _as_it_is(connection: Connection, channel: RowMapping) -> RowMapping:
    """The channel's row in this state of the store: rows may have become longer since."""
    here = (channels.c.node == channel["node"]) & (channels.c.channel == channel["channel"])
    return connection.execute(select(channels).where(here)).mappings().one()
