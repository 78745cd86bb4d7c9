"""Export all samples of channels in a window, in parts, resumable after any frame.

The only state between two parts is a position in the order of frames, so that an export of any
length takes constant memory, and no transaction stays open while a slow client reads.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

from eskin_cloud.store.read.patch_columns import count_samples, read_column, split_column
from eskin_cloud.store.read.window import Window, clip

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from contextlib import AbstractContextManager

    from sqlalchemy import Connection

    from eskin_cloud.store.column_runs import ColumnRun
    from eskin_cloud.store.read.lookup import Channel


class ExportPosition(NamedTuple):
    """The position in an export of what a frame holds of a channel.

    Channels come one after the other, each in order of time.

    Attributes:
        channel: Index of the channel in the query.
        t: Middle of its first sample's time, UTC ns.
        boot: Its node's boot.
        sequence: The frame's sequence number.
    """

    channel: int
    t: int
    boot: int
    sequence: int


def sequence_of(run: ColumnRun) -> int:
    """The sequence number of a run's frame."""
    return run.sequence


@dataclass(frozen=True, slots=True)
class ExportChannel:
    """A channel to export, and where its frames are read.

    Attributes:
        channel: The channel.
        open: Opens a read transaction, for one part.
        number: Returns the exported sequence number of a run.
    """

    channel: Channel
    open: Callable[[], AbstractContextManager[Connection]]
    number: Callable[[ColumnRun], int] = sequence_of


class ExportPart(NamedTuple):
    """Consecutive samples of one channel, in runs of one frame each."""

    channel: Channel
    runs: Sequence[ColumnRun]
    number: Callable[[ColumnRun], int]


@dataclass(frozen=True, slots=True)
class Export:
    """An export.

    Attributes:
        sources: The channels, in the order of the answer.
        window: The window.
        after: The last position of an earlier part; ``None`` for the beginning.
    """

    sources: Sequence[ExportChannel]
    window: Window
    after: ExportPosition | None

    def samples(self) -> int:
        """The number of samples in the window, of all channels."""
        total = 0
        for source in self.sources:
            with source.open() as connection:
                total += count_samples(connection, source.channel, self.window)
        return total

    def find_end(self, limit: int) -> ExportPosition | None:
        """The position that completes ``limit`` samples; ``None`` if nothing follows it.

        A frame is never cut: the last one may exceed the limit.
        """
        left = limit
        last: ExportPosition | None = None
        for index in self._indices():
            for page in self._pages(index, None):
                for run in page:
                    if left <= 0:
                        return last
                    first, final = clip(run.t, run.dt, run.lo.size, self.window)
                    left -= final - first + 1
                    last = ExportPosition(index, *_place(run))
        return None

    def read(self, until: ExportPosition | None) -> Iterator[ExportPart]:
        """Read samples in order, up to and including ``until``."""
        for index in self._indices():
            if until is not None and index > until.channel:
                return
            source = self.sources[index]
            for page in self._pages(index, until):
                yield ExportPart(source.channel, page, source.number)

    def _indices(self) -> range:
        """The remaining channels."""
        return range(0 if self.after is None else self.after.channel, len(self.sources))

    def _pages(self, index: int, until: ExportPosition | None) -> Iterator[Sequence[ColumnRun]]:
        """The runs of a channel in order, in pages; compaction between them changes no position."""
        source, window = self.sources[index], self.window
        after = self.after[1:] if self.after is not None and self.after.channel == index else None
        last = until[1:] if until is not None and until.channel == index else None
        begin = window.start if after is None else max(after[0], window.start)
        at = begin
        while at < window.end and (at == begin or last is None or at <= last[0]):
            with source.open() as connection:
                part = next(split_column(connection, source.channel, Window(at, window.end)))
                runs = read_column(connection, source.channel, part)
            page = [
                run
                for run in runs
                # A run that began before was in the part before.
                if (at == begin or run.t >= at)
                and (after is None or _place(run) > after)
                and (last is None or _place(run) <= last)
            ]
            if page:
                yield page
            at = part.end


def _place(run: ColumnRun) -> tuple[int, int, int]:
    """Where a run stands in the order of its channel."""
    return run.t, run.boot, run.sequence
