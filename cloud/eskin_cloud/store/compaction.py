"""Compact old frames of a page into rows of its patches, some seconds of frames at a time.

Rows are built from a snapshot, without the write lock; one transaction inserts them, moves the
totals and deletes the frames, if all of them still exist. Damaged frames stay. Numbers and digests
of all frames stay, so a copy of a compacted frame is still a duplicate.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Final, NamedTuple, TypeAlias

import numpy as np
from sqlalchemy import and_, delete, func, select, tuple_

from eskin.runtime.digest import digest
from eskin.wire.frames import Sampling
from eskin.wire.frames.frame import read_head
from eskin.wire.slot import SLOTS
from eskin.wire.timestamp import SECOND
from eskin_cloud.store.damage import FrameHeader, PatchRowHeader, is_intact_row
from eskin_cloud.store.descriptions import find_intact_layout
from eskin_cloud.store.feed_entry import note_compacted
from eskin_cloud.store.patch_rows import MOST_CELLS, encode_runs
from eskin_cloud.store.patch_totals import add_rows
from eskin_cloud.store.read.patch_runs import runs_of_frames
from eskin_cloud.store.schema.frame_tables import frames, pages, patch_rows
from eskin_cloud.store.schema.node_key import of_node
from eskin_cloud.store.schema.tables import feed
from eskin_cloud.store.write.bulk_insert import insert_many

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from sqlalchemy import ColumnElement, Connection, MappingResult, RowMapping

    from eskin.wire.frames import Patch
    from eskin_cloud.store.patch_run import PatchRun
    from eskin_cloud.store.store import Store
    from eskin_cloud.store.write.write_cache import Row, WriteCache

SHORTEST: Final = 10 * SECOND
"""Least span of a row, if frames follow each other."""
_LONGEST: Final = 600 * SECOND
"""A row of few samples spans so much."""
_SAMPLES: Final = 8192
"""Samples of a patch in a row, on average of the page; below, it becomes longer."""
_GAP: Final = 60 * SECOND
"""A row ends before such a gap."""
_SETTLED: Final = 3600 * SECOND
"""Frames that are followed by none for so long become a row that is not full."""
_FRAMES: Final = 1024
"""Most frames of a row."""
_HEADS: Final = tuple(
    frames.c[name] for name in ("boot", "sequence", "t", "t_end", "samples", "received")
)
PageKey: TypeAlias = tuple[int, str, bytes, int]
"""Slot, node, layout and number of a page."""


class Due(NamedTuple):
    """Which frames are compacted.

    Attributes:
        received: Those received until then, UTC ns.
        settled: Of those received until then, UTC ns, also too few for a row.
        ended: Of those whose samples ended before it, UTC ns, all, whenever they came.
    """

    received: int
    settled: int
    ended: int = -(2**63)

    @classmethod
    def after(cls, now: int, age: int) -> Due:
        """Frames of an age in ns."""
        return cls(now - age, now - max(age, _SETTLED))

    def includes(self, head: RowMapping) -> bool:
        """Whether a frame is compacted, if enough follow it."""
        return bool(head["received"] <= self.received or head["t_end"] < self.ended)

    def includes_few(self, heads: Sequence[RowMapping]) -> bool:
        """Whether frames are compacted though they do not fill a row."""
        return all(head["received"] <= self.settled or head["t_end"] < self.ended for head in heads)


@dataclass(frozen=True, slots=True)
class CompactedFrames:
    """Rows that replace frames of a page.

    Attributes:
        page: The page.
        gone: Boot and sequence of the replaced frames.
        latest: The latest of their cursors; 0 if there are none.
        samples: Of the replaced frames.
        size: Bytes of the replaced frames.
        rows: Rows of `patch_rows`, and the period of each.
        since: Start of the frames, UTC ns; ``None`` for the page's beginning.
        until: Up to where the page is compacted.
        cursor: Latest cursor in the snapshot.
    """

    page: PageKey
    gone: Sequence[tuple[int, int]]
    latest: int
    samples: int
    size: int
    rows: Sequence[tuple[Row, int]]
    since: int | None
    until: int
    cursor: int


def find_compactable_frames(
    store: Store, due: Due, slots: Iterable[int] = range(SLOTS)
) -> list[PageKey]:
    """Pages with frames that are old enough.

    Args:
        store: The store.
        due: Which frames are.
        slots: Whose nodes' pages are given.

    Raises:
        StoreError: The store cannot be read.
    """
    p = pages.c
    with store.read() as connection:
        query = select(p.slot, p.node, p.layout, p.page, p.compacted).where(p.frames > 0)
        query = query.where(p.slot.in_(list(slots))).order_by(p.slot, p.node, p.layout, p.page)
        found = []
        for *key, since in connection.execute(query).all():
            first = _heads(connection, (key[0], key[1], key[2], key[3]), since, 1).first()
            if first is not None and due.includes(first):
                found.append((key[0], key[1], key[2], key[3]))
    return found


def compact_frames(store: Store, page: PageKey, due: Due) -> bool:
    """Compact the page's next frames, one row a patch; returns whether there may be more.

    Raises:
        StoreError: The store cannot be read or written.
    """
    with store.read() as connection:
        made = _compact(connection, page, due)
    if made is None:
        return False
    store.compacted += made.size
    work = partial(_replace, made=made)
    return store.write_slots([page[0]], work).result()


def _within(page: PageKey) -> ColumnElement[bool]:
    f = frames.c
    return and_(of_node(frames, page[1]), f.page == page[3], f.layout == page[2])


def _heads(connection: Connection, page: PageKey, since: int | None, most: int) -> MappingResult:
    f = frames.c
    query = select(*_HEADS).where(_within(page)).order_by(f.t, f.boot, f.sequence)
    if since is not None:
        query = query.where(f.t >= since)
    return connection.execute(query.limit(most)).mappings()


def _compact(connection: Connection, page: PageKey, due: Due) -> CompactedFrames | None:
    p, f = pages.c, frames.c
    here = and_(of_node(pages, page[1]), p.layout == page[2], p.page == page[3])
    totals = connection.execute(select(p.compacted).where(here)).one_or_none()
    if totals is None:
        return None
    described = find_intact_layout(connection, page[1], page[2])
    if described is None:
        return None  # its frames stay
    since = totals.compacted
    numbers = described.page_ranges[page[3]]
    with _heads(connection, page, since, _FRAMES + 1) as heads:  # most rows take few of them
        taken, following = _take(heads, due, _SAMPLES * len(numbers))
    if not taken:
        return None
    last = taken[-1]["t"]
    until = last + 1 if following is None else following["t"]
    query = select(frames).where(_within(page), f.t <= last)
    if since is not None:
        query = query.where(f.t >= since)
    query = query.order_by(f.t, f.boot, f.sequence).limit(len(taken))
    columns = sum(len(described.patches[number].taxels) for number in numbers)
    gone: list[RowMapping] = []
    cells = 0
    for row in filter(_is_intact, connection.execute(query).mappings().all()):
        cells += columns * _most_rows(row)
        if gone and cells > MOST_CELLS:  # with strides, few samples may lie in many cells
            until = row["t"]
            break
        gone.append(row)
    if until == since and not gone:
        return None
    runs: dict[int, list[PatchRun]] = defaultdict(list)
    if gone:
        for number, run in runs_of_frames(gone, described, numbers):
            runs[number].append(run)
    return CompactedFrames(
        page=page,
        gone=[(row["boot"], row["sequence"]) for row in gone],
        latest=max((row["cursor"] for row in gone), default=0),
        samples=sum(row["samples"] for row in gone),
        size=sum(len(row["data"]) for row in gone),
        rows=[
            (_row(page, described.patches[number], described.layout.patches[number], each),
             each[0].dt)
            for number, each in runs.items()
        ],
        since=since,
        until=until,
        cursor=connection.execute(select(feed.c.cursor).where(feed.c.slot == page[0])).scalar_one(),
    )  # fmt: skip


def _take(
    heads: Iterator[RowMapping], due: Due, samples: int
) -> tuple[list[RowMapping], RowMapping | None]:
    """The first frames, which become a row, and the next one; none if they are not enough yet."""
    taken: list[RowMapping] = []
    end, found = -(2**63), 0
    for head in heads:
        if taken and (head["t"] - end > _GAP or len(taken) == _FRAMES or found >= MOST_CELLS // 2):
            return taken, head
        if not due.includes(head):
            return (taken if due.includes_few(taken) else []), head
        taken.append(head)
        end, found = max(end, head["t_end"]), found + head["samples"]
        span = end - taken[0]["t"]
        if span >= SHORTEST and (found >= samples or span >= _LONGEST):
            return taken, next(heads, None)
    return (taken if due.includes_few(taken) else []), None


def _most_rows(row: RowMapping) -> int:
    """Rows of a frame's longest grid."""
    return max(grid.rows for grid in read_head(row["data"]).grids)


def _is_intact(row: RowMapping) -> bool:
    return is_intact_row(FrameHeader, row)


def _row(page: PageKey, patch: Patch, name: bytes, runs: list[PatchRun]) -> Row:
    """The row of some runs of a patch."""
    runs.sort(key=lambda run: (run.t, run.boot, run.sequence))
    data = encode_runs(runs)
    found = [_measure(run, patch) for run in runs]
    row: Row = {
        "slot": page[0],
        "node": page[1],
        "patch": patch.patch_id,
        "t": min(each.first for each in found),
        "boot": runs[0].boot,
        "sequence": runs[0].sequence,
        "hash": name,
        "t_end": max(each.last for each in found),
        "error": max(run.error for run in runs),
        "frames": len(runs),
        "samples": sum(each.samples for each in found),
        "lo": min(each.lo for each in found),
        "hi": max(each.hi for each in found),
        "coverage": min(run.coverage for run in runs),
        "data": data,
        "digest": digest(data),
    }
    return row | {"head": PatchRowHeader.of(row).checksum()}


class _Measures(NamedTuple):
    """Of a run: the middles of its first and last time, its samples, and their hull."""

    first: int
    last: int
    samples: int
    lo: float
    hi: float


def _measure(run: PatchRun, patch: Patch) -> _Measures:
    rows, columns = run.lo.shape
    lo, hi = run.lo, run.hi
    if run.strides:
        mask = Sampling(rows, columns, run.first_row, run.strides).mask
        lo, hi = lo[mask], hi[mask]
        row, column = np.nonzero(mask)
        instants = row * run.dt + np.array(patch.skew or (0,) * columns, np.int64)[column]
        first, last = int(instants.min()), int(instants.max())
    else:
        first, last = min(patch.skew, default=0), max(patch.skew, default=0)
        last += (rows - 1) * run.dt
    return _Measures(run.t + first, run.t + last, lo.size, float(lo.min()), float(hi.max()))


def _replace(connection: Connection, cache: WriteCache, made: CompactedFrames) -> bool:
    """Replace frames by their rows, unless a frame changed meanwhile."""
    f, row = frames.c, cache.row(connection, pages, *made.page)
    if row is None or row["compacted"] != made.since:
        return False
    if made.gone:
        where = and_(
            of_node(frames, made.page[1]),
            tuple_(f.boot, f.sequence).in_(made.gone),
        )
        here = select(func.count()).select_from(frames).where(where)
        if connection.execute(here).scalar_one() != len(made.gone):
            return False
        connection.execute(delete(frames).where(where))
        note_compacted(connection, made.latest)
        insert_many(connection, patch_rows, [each for each, _ in made.rows])
        for each, dt in made.rows:
            add_rows(connection, [each], dt)
        _subtract(connection, row, made)
    # A frame that came meanwhile may be earlier.
    since = select(func.min(f.t)).where(_within(made.page), f.cursor > made.cursor)
    late = connection.execute(since.where(f.t < made.until)).scalar_one()
    row["compacted"] = made.until if late is None else late
    cache.change(pages, *made.page)
    return True


def _subtract(connection: Connection, row: Row, made: CompactedFrames) -> None:
    """Subtract frames from a page's totals."""
    row["frames"] -= len(made.gone)
    row["samples"] -= made.samples
    row["bytes"] -= made.size
    f = frames.c
    first = select(f.t).where(_within(made.page)).order_by(f.t).limit(1)
    row["t_first"] = connection.execute(first).scalar_one_or_none()
    if row["t_first"] is None:
        row["t_last"] = None
