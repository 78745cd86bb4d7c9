"""Entries of the feed as events of a stream; each is written once for all who look on."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from cachetools import FIFOCache

from eskin.union_bound import union_coverage
from eskin.wire.messages import Block, BlockSummary, decode_summary
from eskin.wire.timestamp import format_timestamp
from eskin_cloud.live.frame_hulls import describe_frames, join_frames, read_hulls
from eskin_cloud.query.series import Series, reduce_samples
from eskin_cloud.schemas.base import Json, dump
from eskin_cloud.schemas.events import describe_event
from eskin_cloud.schemas.series import describe_series
from eskin_cloud.store.read.block_index import Samples

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from eskin_cloud.live.layouts import Layouts
    from eskin_cloud.live.subscription import Subscription
    from eskin_cloud.query.opaque_ids import OpaqueIds
    from eskin_cloud.store.feed_entry import FeedEntry

_KEPT: Final = 512
_PAGES: Final = 16


class SseEncoder:
    """Prints entries, and keeps the latest ones for the next who asks for the same.

    What was sealed is not kept.

    Args:
        ids: Writes cursors.
        layouts: Those of the frames, loaded.
    """

    def __init__(self, ids: OpaqueIds, layouts: Layouts) -> None:
        self.ids = ids
        self._layouts = layouts
        self._kept = lru_cache(_KEPT)(self._of_block)
        self._frames: FIFOCache[tuple[int, frozenset[str] | None], bytes] = FIFOCache(_KEPT)
        self._pages: FIFOCache[tuple[int, int, Subscription], bytes] = FIFOCache(_PAGES)

    def page(self, found: Sequence[FeedEntry], selection: Subscription) -> bytes:
        """What is asked for of neighbours in the feed, of which nothing is sealed.

        Many readers select the same: their entries are encoded once.
        """
        if not found:
            return b""
        key = found[0].cursor, found[-1].cursor, selection
        page = self._pages.get(key)
        if page is None:
            said = [(entry, True) for entry in found if selection.takes(entry)]
            page = self._pages[key] = self.print(said, selection)
        return page

    def print(self, said: Sequence[tuple[FeedEntry, bool]], selection: Subscription) -> bytes:
        """Entries as events of the stream.

        Args:
            said: Each with whether others may be given the same bytes.
            selection: How finely blocks are asked for.
        """
        return b"".join(self._event(entry, selection, keep=keep) for entry, keep in said)

    def _event(self, entry: FeedEntry, selection: Subscription, *, keep: bool) -> bytes:
        if entry.frame is not None:
            channels = selection.channels_of(entry.node)
            if not keep:
                return self._print_frame(entry, channels)
            return self._of_frame(entry, channels)
        if entry.block is None:
            return self.of_row(entry.cursor, entry.event or {})
        write = self._kept if keep else self._of_block
        fine = selection.points, selection.grain
        return write(entry.cursor, entry.node, entry.block, *fine, entry.received)

    def _of_frame(self, entry: FeedEntry, channels: frozenset[str] | None) -> bytes:
        """A frame; nothing where it has none of the channels, or its layout is lost."""
        key = entry.cursor, channels
        if key not in self._frames:
            self._frames[key] = self._print_frame(entry, channels)
        return self._frames[key]

    def _print_frame(self, entry: FeedEntry, channels: frozenset[str] | None) -> bytes:
        hulls = read_hulls(entry, self._layouts.get(entry.layout), channels)
        return b"" if hulls is None else self.event("frame", entry.cursor, describe_frames(hulls))

    def of_row(self, cursor: int, row: dict[str, Any]) -> bytes:
        """An event's row as an event of the stream."""
        return self.event(str(row["kind"]), cursor, describe_event(row, self.ids))

    def event(self, kind: str, cursor: int, data: object) -> bytes:
        """One event of a stream."""
        said = kind.encode(), self.ids.write(cursor).encode(), dump(data)
        return b"event: %b\nid: %b\ndata: %b\n\n" % said

    def _of_block(
        self, cursor: int, node: str, data: bytes, points: int, grain: int, received: int
    ) -> bytes:
        series = reduce_block(node, Block.decode(data), points, grain)
        return self.event("block", cursor, _shape(series, received))

    def join(self, entries: Sequence[FeedEntry], begun: int, selection: Subscription) -> bytes:
        """Many entries at once, for one who reads too slowly: fewer events, and wider hulls.

        Blocks of a channel, and frames of a page, that follow each other without a gap become one
        hull; all else is sent as it is. Only the last event carries the last entry's cursor, so a
        reader that breaks off before it is sent all of them again.

        Args:
            entries: In order of their cursors, at least one.
            begun: The cursor before them.
            selection: Which channels of frames are asked for.
        """
        events: list[tuple[str, Mapping[str, object]]] = [
            ("block", _shape(run.series, run.received)) for run in _runs(entries)
        ]
        read = (
            read_hulls(entry, self._layouts.get(entry.layout), selection.channels_of(entry.node))
            for entry in entries
            if entry.frame is not None
        )
        events += [("frame", describe_frames(hulls)) for hulls in join_frames(read)]
        rows = [entry.event for entry in entries if entry.block is None and entry.event]
        events += [(str(row["kind"]), describe_event(row, self.ids)) for row in rows]
        cursors = [begun] * (len(events) - 1) + [entries[-1].cursor]
        return b"".join(
            self.event(kind, at, data) for (kind, data), at in zip(events, cursors, strict=True)
        )


def _shape(series: Series, received: int) -> Json:
    return describe_series(series) | {"stored": format_timestamp(received)}


def reduce_block(node: str, block: Block, points: int, grain: int = 0) -> Series:
    """A block as a series of at most ``points`` entries, none of them shorter than it need be.

    Args:
        node: Whose it is.
        block: The block.
        points: Most entries.
        grain: Samples that lie so much apart (ns) in all may become one entry.
    """
    tube = block.tube
    if grain > 0:
        points = min(points, max(1, len(tube) * tube.dt // grain))
    samples = Samples(
        tube.moments,
        np.full(len(tube), tube.dt, np.int64),
        tube.values.inf,
        tube.values.sup,
    )
    reduced, stride, largest = reduce_samples(samples, points)
    return Series(
        node=node,
        channel=block.channel,
        unit=tube.unit,
        coverage=tube.coverage if stride == 1 else union_coverage(tube.coverage, n=largest),
        resolution="sample" if stride == 1 else "hull",
        t0=tube.first_moment,
        t=reduced.t - tube.first_moment,
        lo=reduced.lo,
        hi=reduced.hi,
        dt=tube.dt * stride,
        time_error=tube.time_error,
    )


@dataclass(frozen=True, slots=True)
class Run:
    """Blocks of one channel without a gap between them.

    Attributes:
        node: Who sent them.
        first: The first of them.
        start: Middle of the first sample's moment, UTC ns.
        end: One period after that of the last sample.
        n: All samples.
        lo: The least of their lower bounds.
        hi: The greatest of their upper bounds.
        coverage: The least of theirs.
        time_error: The greatest of theirs, in ns.
        received: When the cloud stored the last of them, UTC ns.
    """

    node: str
    first: BlockSummary
    start: int
    end: int
    n: int
    lo: float
    hi: float
    coverage: float
    time_error: int
    received: int

    @classmethod
    def of(cls, node: str, block: BlockSummary, received: int) -> Run:
        """One block."""
        earliest, latest = block.time
        start = (earliest + latest) // 2
        end = start + block.n * block.dt
        error = (latest - earliest + 1) // 2
        said = *block.bounds, block.coverage
        return cls(node, block, start, end, block.n, *said, error, received)

    def joined(self, other: Run) -> Run | None:
        """With those that come next; ``None`` if they do not follow at once, or are others."""
        mine, theirs = self.first, other.first
        same = (mine.dt, mine.unit) == (theirs.dt, theirs.unit)
        # Half a period late is no gap yet, as everywhere (`store.read.block_index.longest_step`).
        if not same or abs(other.start - self.end) > mine.dt // 2:
            return None
        return replace(
            self,
            end=other.end,
            n=self.n + other.n,
            lo=min(self.lo, other.lo),
            hi=max(self.hi, other.hi),
            coverage=min(self.coverage, other.coverage),
            time_error=max(self.time_error, other.time_error),
            received=other.received,
        )

    @property
    def series(self) -> Series:
        """Their hull."""
        return Series(
            node=self.node,
            channel=self.first.channel,
            unit=self.first.unit,
            coverage=union_coverage(self.coverage, n=self.n),
            resolution="hull",
            t0=self.start,
            t=np.zeros(1, np.int64),
            lo=np.array([self.lo]),
            hi=np.array([self.hi]),
            dt=self.end - self.start,
            time_error=self.time_error,
        )


def _runs(entries: Iterable[FeedEntry]) -> list[Run]:
    found: list[Run] = []
    latest: dict[tuple[str, str], int] = {}
    for entry in entries:
        block = None if entry.block is None else decode_summary(entry.block)
        if not isinstance(block, BlockSummary):
            continue
        run, place = Run.of(entry.node, block, entry.received), (entry.node, block.channel)
        at = latest.get(place)
        joined = None if at is None else found[at].joined(run)
        if at is None or joined is None:
            latest[place] = len(found)
            found.append(run)
        else:
            found[at] = joined
    return found
