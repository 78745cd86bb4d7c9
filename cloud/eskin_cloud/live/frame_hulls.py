"""Frames as hulls of their channels, for clients that read JSON."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from eskin.union_bound import union_coverage
from eskin.wire.frames import Sampling
from eskin.wire.frames.frame import read_head
from eskin.wire.frames.frame_scan import Part, scan_frames
from eskin.wire.timestamp import format_timestamp

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from eskin.interval import Floats
    from eskin.wire.frames import DescribedLayout
    from eskin_cloud.schemas.base import Json
    from eskin_cloud.store.feed_entry import FeedEntry


@dataclass(frozen=True, slots=True)
class PatchHull:
    """The hull of each channel of a patch over some rows.

    Attributes:
        patch: The patch's id.
        unit: Its unit.
        channels: Those of the columns that were asked for; ``None`` if all were.
        start: Middle of the first row's time, UTC ns; a column is later by its skew.
        end: One period after that of the last row.
        period: From row to row, ns.
        n: How many rows.
        coverage: The least of their samples'.
        lo: The least lower bound of each column.
        hi: The greatest upper bound.
    """

    patch: str
    unit: str
    channels: tuple[str, ...] | None
    start: int
    end: int
    period: int
    n: int
    coverage: float
    lo: Floats
    hi: Floats

    def follows(self, before: PatchHull) -> bool:
        """Whether this hull begins where another one of the same channels ended."""
        # Half a period late is no gap yet, as everywhere (`rollup.aggregates.longest_step`).
        same = (self.patch, self.period) == (before.patch, before.period)
        return same and abs(self.start - before.end) <= self.period // 2

    def joined(self, later: PatchHull) -> PatchHull:
        """With the rows that come next."""
        return replace(
            self,
            end=later.end,
            n=self.n + later.n,
            coverage=min(self.coverage, later.coverage),
            lo=np.minimum(self.lo, later.lo),
            hi=np.maximum(self.hi, later.hi),
        )


@dataclass(frozen=True, slots=True)
class FrameHulls:
    """Hulls of one page.

    Attributes:
        node: The node.
        layout: Hash of the layout.
        page: The page.
        t0: Middle of the first instant's time, UTC ns.
        time_error: Greatest distance of an instant from its middle, ns.
        received: When the cloud stored the last of the frames, UTC ns.
        patches: In the order of the layout; the hulls of one patch in order of time.
    """

    node: str
    layout: bytes
    page: int
    t0: int
    time_error: int
    received: int
    patches: tuple[PatchHull, ...]

    def follows(self, before: FrameHulls) -> bool:
        """Whether all patches go on where those of another frame of the page ended."""
        same = (self.layout, len(self.patches)) == (before.layout, len(before.patches))
        pairs = zip(self.patches, before.patches, strict=False)
        return same and all(later.follows(earlier) for later, earlier in pairs)

    def joined(self, later: FrameHulls) -> FrameHulls:
        """With the frame that comes next."""
        pairs = zip(self.patches, later.patches, strict=True)
        return replace(
            self,
            time_error=max(self.time_error, later.time_error),
            received=later.received,
            patches=tuple(one.joined(other) for one, other in pairs),
        )


def read_hulls(
    entry: FeedEntry,
    described: DescribedLayout | None,
    channels: frozenset[str] | None,
    points: int = 1,
) -> FrameHulls | None:
    """The hulls of a frame's channels.

    Args:
        entry: A frame.
        described: The layout by which it is read.
        channels: These only; ``None`` for all.
        points: Hulls that the rows of a patch become at most, each of as many rows.

    Returns:
        ``None`` where the frame has none of the channels, or there is no layout to read it by.
    """
    if described is None or entry.frame is None:
        return None
    head = read_head(entry.frame)
    records = scan_frames([entry.frame], np.ones(len(described.patches), np.bool_))
    t0 = sum(head.time) // 2
    patches = []
    for record, row in enumerate(records.whole.tolist()):
        patch = described.patches[row[Part.PATCH]]
        columns = named = None
        if channels is not None:
            columns = [k for k, name in enumerate(patch.channels) if name in channels]
            named = tuple(patch.channels[k] for k in columns)
            if not columns:
                continue
        cells = slice(row[Part.BEGIN], row[Part.BEGIN] + row[Part.ROWS] * row[Part.COLUMNS])
        shape = row[Part.ROWS], row[Part.COLUMNS]
        lo, hi = records.lo[cells].reshape(shape), records.hi[cells].reshape(shape)
        step, period = -(-row[Part.ROWS] // points), row[Part.PERIOD]
        for first in range(0, row[Part.ROWS], step):
            part = slice(first, first + step)
            sampling = Sampling(
                len(lo[part]),
                row[Part.COLUMNS],
                row[Part.FIRST_ROW] + first,
                records.strides(record),
            )
            least, most = _hull(sampling, lo[part], hi[part])
            start = t0 + row[Part.DELAY] + first * period
            patches.append(
                PatchHull(
                    patch=patch.patch_id,
                    unit=patch.unit,
                    channels=named,
                    start=start,
                    end=start + sampling.rows * period,
                    period=period,
                    n=sampling.rows,
                    coverage=float(records.coverage[record]),
                    lo=least if columns is None else least[columns],
                    hi=most if columns is None else most[columns],
                )
            )
    if not patches:
        return None
    error = (head.time[1] - head.time[0] + 1) // 2
    return FrameHulls(entry.node, head.layout, head.page, t0, error, entry.received, tuple(patches))


def _hull(sampling: Sampling, lo: Floats, hi: Floats) -> tuple[Floats, Floats]:
    """The hull of each column's samples; unbounded where it has none."""
    if not sampling.strides:
        return lo.min(axis=0), hi.max(axis=0)
    mask = sampling.mask
    least = np.where(mask, lo, np.inf).min(axis=0)
    most = np.where(mask, hi, -np.inf).max(axis=0)
    sampled = mask.any(axis=0)
    return np.where(sampled, least, -np.inf), np.where(sampled, most, np.inf)


def join_frames(frames: Iterable[FrameHulls | None]) -> Sequence[FrameHulls]:
    """Frames of a page that follow each other without a gap as one."""
    found: list[FrameHulls] = []
    latest: dict[tuple[str, int], int] = {}
    for each in frames:
        if each is None:
            continue
        place = each.node, each.page
        at = latest.get(place)
        if at is not None and each.follows(found[at]):
            found[at] = found[at].joined(each)
        else:
            latest[place] = len(found)
            found.append(each)
    return found


def describe_frames(hulls: FrameHulls) -> Json:
    """A frame, or several that follow each other: each patch's hulls over its ``n`` rows.

    The rows of a hull begin ``t`` ns after ``t0`` and last ``dt`` ns; ``channels`` names its
    columns where not all were asked for.
    """
    return {
        "node": hulls.node,
        "layout": hulls.layout.hex(),
        "page": hulls.page,
        "t0": format_timestamp(hulls.t0),
        "time_error": hulls.time_error,
        "stored": format_timestamp(hulls.received),
        "patches": [
            {
                "patch": each.patch,
                "unit": each.unit,
                "coverage": union_coverage(each.coverage, n=each.n),
                "t": each.start - hulls.t0,
                "dt": each.end - each.start,
                "n": each.n,
                "lo": each.lo,
                "hi": each.hi,
            }
            | ({} if each.channels is None else {"channels": each.channels})
            for each in hulls.patches
        ],
    }
