"""Exports: all samples of channels in a window, part by part, resumable behind any block.

Nothing is held between two parts but a place in the order of blocks, so that an export of any
length takes constant memory and no transaction stays open while a slow client reads.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import chain
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from sqlalchemy import select, tuple_

from cloud.query.span import clip, count, touching
from cloud.store.schema import blocks
from eskin.messages import Block

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from contextlib import AbstractContextManager

    from sqlalchemy import ColumnElement, Connection, RowMapping, Select

    from cloud.query.window import Window

_AT_ONCE: Final = 128
"""Blocks in one part: 128,000 samples at most."""
_MARKS: Final = 4096
"""Blocks that are counted at a time."""


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


@dataclass(frozen=True, slots=True)
class Source:
    """A channel, and where its blocks are read.

    Attributes:
        channel: The channel's row.
        open: Gives a connection, for one part.
    """

    channel: RowMapping
    open: Callable[[], AbstractContextManager[Connection]]


class Part(NamedTuple):
    """Some consecutive blocks of one channel."""

    channel: RowMapping
    blocks: Sequence[Block]


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
                total += count(connection, source.channel, self.window)
        return total

    def find_end(self, limit: int) -> Mark | None:
        """The block with which ``limit`` samples are full; ``None`` where there is nothing behind.

        A block is never cut for it: the last one may bring some more.
        """
        left = limit
        last: Mark | None = None
        b = blocks.c
        for index, begin in self._marks():
            rows = self._rows(
                select(b.t, b.boot, b.sequence, b.n, b.dt), index, begin, None, _MARKS
            )
            for t, boot, sequence, n, dt in chain.from_iterable(rows):
                if left <= 0:
                    return last
                first, final = clip(t, dt, n, self.window)
                left -= max(0, final - first + 1)
                last = Mark(index, t, boot, sequence)
        return None

    def read(self, until: Mark | None) -> Iterator[Part]:
        """Decode blocks in order, up to and with ``until``."""
        b = blocks.c
        for index, begin in self._marks():
            if until is not None and index > until.channel:
                return
            chosen = select(b.t, b.boot, b.sequence, b.data)
            for rows in self._rows(chosen, index, begin, until, _AT_ONCE):
                yield Part(self.sources[index].channel, [Block.decode(data) for *_, data in rows])

    def _rows(
        self, query: Select[Any], index: int, after: Mark | None, until: Mark | None, most: int
    ) -> Iterator[Sequence[Any]]:
        """A channel's blocks, so many at a time; the query begins with their marks."""
        while True:
            with self.sources[index].open() as connection:
                asked = self._ordered(query, index, after, until).limit(most)
                rows = connection.execute(asked).all()
            if rows:
                yield rows
            if len(rows) < most:
                return
            t, boot, sequence, *_ = rows[-1]
            after = Mark(index, t, boot, sequence)

    def _marks(self) -> Iterator[tuple[int, Mark | None]]:
        """The channels that are left, each with the block behind which it begins."""
        first = 0 if self.after is None else self.after.channel
        for index in range(first, len(self.sources)):
            yield index, self.after if index == first else None

    def _ordered(
        self, query: Select[Any], index: int, after: Mark | None, until: Mark | None
    ) -> Select[Any]:
        b = blocks.c
        key = tuple_(b.t, b.boot, b.sequence)
        where: list[ColumnElement[bool]] = [touching(self.sources[index].channel, self.window)]
        if after is not None:
            where += [b.t >= after.t, key > after[1:]]
        if until is not None and until.channel == index:
            where += [b.t <= until.t, key <= until[1:]]
        return query.where(*where).order_by(b.t, b.boot, b.sequence)
