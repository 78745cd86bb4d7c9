"""Read pictures of a skin: from tiles where they are built, else from samples."""

from __future__ import annotations

from itertools import groupby
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np
from sqlalchemy import and_, func, select

from eskin.errors import QueryError
from eskin.wire.frames.frame_scan import Part, scan_frames
from eskin.wire.timestamp import MOST_INSTANT
from eskin_cloud.rollup.buckets import Buckets
from eskin_cloud.rollup.column_aggregates import COVERAGE, ERROR
from eskin_cloud.rollup.hulls import bucket_width
from eskin_cloud.rollup.patch_tiles import read_chunk, taxels_of
from eskin_cloud.rollup.picture_fold import (
    ColumnPlaces,
    PictureHulls,
    close_gaps,
    fold_matrix,
    fold_records,
    fold_tiles,
)
from eskin_cloud.rollup.ranges import Range, coarsened, merged, refined, without
from eskin_cloud.store.damage import FrameHeader, PatchRowHeader, are_countable, is_intact_row
from eskin_cloud.store.descriptions import find_layout, find_patch
from eskin_cloud.store.patch_rows import decode_matrix
from eskin_cloud.store.patch_totals import Place
from eskin_cloud.store.read.patch_runs import read_frame_rows, read_pages
from eskin_cloud.store.read.window import Window, before
from eskin_cloud.store.row_digests import intact_rows
from eskin_cloud.store.sample_grid import PATCH_CHUNK, STEP, TOP
from eskin_cloud.store.schema.frame_tables import (
    frames,
    patch_rows,
    patch_tiles,
    patches,
    stale_patch_chunks,
)
from eskin_cloud.store.schema.node_key import of_node

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from sqlalchemy import ColumnElement, Connection, RowMapping, Table

    from eskin.wire.frames import Patch
    from eskin.wire.frames.frame_scan import Records
    from eskin_cloud.rollup.aggregates import Integers

MOST_FRAMES: Final = 5000
"""Most frames that are decoded for an answer."""
MOST_ROWS: Final = 2000
"""Most compacted rows that are decoded for an answer."""
_AT_ONCE: Final = 128
_COARSER: Final = 4
"""Pictures may be so many times longer than asked for, if they are tiles."""
_TILE_SAMPLES: Final = 16
"""Samples of a column in the smallest tile, at least."""
FARTHEST: Final = 60_000_000_000
"""A sample beside the pictures is looked at if its true time lies at most so far from its middle,
in ns. One whose time is less certain is a gap in what its node says."""


class _Tiles(NamedTuple):
    """Tiles of a level: from a first one up to, and without, an end."""

    level: int
    first: int
    end: int

    @property
    def start(self) -> int:
        """When they begin, UTC ns."""
        return self.first << self.level


class PictureReader:
    """Folds the samples of some channels of a node into pictures.

    Args:
        connection: In a read transaction.
        node: The node.
        chosen: The patches whose columns are the pictures' channels, in this order.
        spread: Whether a sample belongs to each picture that its true time may lie in, because
            samples of other clocks are beside it; else to the one of the middle of its time.
        share: A reader of so many that read for an answer, and so much less than all may be read.

    Attributes:
        coverage: Least coverage of all samples that were read.
        time_error: Greatest of their time errors, ns.

    Raises:
        UnknownDescriptionError: A description is damaged in the store.
    """

    def __init__(
        self,
        connection: Connection,
        node: str,
        chosen: Sequence[Patch],
        *,
        spread: bool = False,
        share: int = 1,
    ) -> None:
        self.coverage, self.time_error = 1.0, 0
        self._spread, self._share = spread, share
        self._connection, self._node = connection, node
        names = (name for patch in chosen for name in patch.channels)
        self._channels = {name: number for number, name in enumerate(names)}
        self._layouts: dict[bytes, ColumnPlaces] = {}
        self._longest: dict[int, int] = {}
        for row in read_pages(connection, node):
            described = find_layout(connection, node, bytes(row["layout"]))
            if described.hash not in self._layouts:
                self._layouts[described.hash] = self._place(described.patches)
            numbers = list(described.page_ranges[row["page"]])
            if np.any(self._layouts[described.hash].channel[numbers] >= 0):
                longest = self._longest.get(row["page"], 0)
                self._longest[row["page"]] = max(longest, row["longest"])
        are_countable(patches.name)  # a row whose key is damaged is not found by it
        query = select(patches).where(self._here(patches)).order_by(patches.c.patch)
        rows = intact_rows(connection, patches, connection.execute(query).mappings())
        self._compacted = {row["patch"]: row for row in rows if self._is_in(row)}
        grains = [row["grain"] for row in self._compacted.values()]
        self._grain: int | None = None if not grains or None in grains else max(grains)

    @property
    def grain(self) -> int | None:
        """The lowest level at which all channels have tiles; ``None`` if there is none."""
        return self._grain

    @property
    def is_silent(self) -> bool:
        """Whether there are no samples at all."""
        return not self._longest and not self._compacted

    def fold(self, buckets: Buckets) -> PictureHulls:
        """Hulls of all samples in some pictures, as `choose` gives them.

        Raises:
            QueryError: Too many frames or rows are covered by no tiles.
        """
        hulls = PictureHulls.empty(buckets.count, len(self._channels))
        grid = buckets.start, buckets.width
        looked = self._widened(buckets) if self._spread else buckets
        window, whole = buckets.window, looked.window
        margin = self.step(window) + (self._reach(window) if self._spread else 0)
        seen = Window(before(window.start, margin), min(window.end + margin, MOST_INSTANT))
        for part in self._parts(looked):
            if isinstance(part, _Tiles):
                self._fold_tiles(part, grid, hulls)
                continue
            start = seen.start if part.start == whole.start else max(part.start, seen.start)
            end = seen.end if part.end == whole.end else min(part.end, seen.end)
            if start < end:
                self._fold_samples(Window(start, end), grid, hulls)
        close_gaps(grid, hulls)
        return hulls

    def _widened(self, buckets: Buckets) -> Buckets:
        """The pictures, and so many before and after as samples of them may be stated in."""
        count = -(-FARTHEST // buckets.width)
        start = buckets.start - count * buckets.width
        return Buckets(start, buckets.width, buckets.count + 2 * count)

    def _reach(self, window: Window) -> int:
        """How far beside a window samples may be stated that belong to it, ns."""
        found = 0
        edges = (
            Window(before(window.start, FARTHEST), window.start),
            Window(window.end, min(window.end + FARTHEST, MOST_INSTANT)),
        )
        for edge in edges:
            for page, longest in self._longest.items():
                found = max(
                    found, self._greatest_error(frames, edge, longest, frames.c.page == page)
                )
            if self._compacted:
                longest = max(row["longest"] for row in self._compacted.values())
                mine = patch_rows.c.patch.in_(list(self._compacted))
                found = max(found, self._greatest_error(patch_rows, edge, longest, mine))
        return min(found, FARTHEST)

    def _greatest_error(
        self, table: Table, window: Window, longest: int, mine: ColumnElement[bool]
    ) -> int:
        t = table.c
        query = select(func.max(t.error)).where(
            self._here(table), mine, t.t >= before(window.start, longest), t.t < window.end
        )
        return self._connection.execute(query).scalar_one() or 0

    def _parts(self, buckets: Buckets) -> list[_Tiles | Window]:
        """Where tiles are read, and where samples, in order of time."""
        window, grain = buckets.window, self._grain
        if grain is None or buckets.width % (1 << grain) or buckets.start % (1 << grain):
            return [window]
        level = grain
        while not (buckets.width | buckets.start) & ((1 << (level + STEP)) - 1) and (
            level + STEP <= TOP
        ):
            level += STEP
        opened = self._find_unbuilt((window.start, window.end))
        found: list[_Tiles | Window] = [Window(*each) for each in opened]
        region = [(window.start >> level, -(-window.end >> level))]
        for each in range(level, grain - 1, -STEP):
            holes = coarsened(opened, each)
            found += [_Tiles(each, *some) for some in without(region, holes)]
            if not holes or each == grain:
                break
            region = refined(_common(region, holes), STEP)
        return sorted(found, key=lambda part: part.start)

    def step(self, window: Window) -> int:
        """The longest step to the next sample without a gap, ns, by the last frames."""
        found = 1 if self._grain is None else (1 << self._grain) // _TILE_SAMPLES
        periods = []
        for page in self._longest:
            row = self._last(page, window)
            if row is None:
                continue
            records = self._scan([row])
            for record, each in enumerate(records.whole.tolist()):
                periods.append(each[Part.PERIOD] << max(records.strides(record), default=0))
        period = max(periods, default=found)
        return period + period // 2

    def _last(self, page: int, window: Window) -> RowMapping | None:
        """The last frame of a page that begins before a window's end, if it is intact."""
        query = select(frames).where(self._here(frames), frames.c.page == page)
        query = query.where(frames.c.t < window.end).order_by(frames.c.t.desc()).limit(1)
        found = self._connection.execute(query).mappings().first()
        if found is None or not is_intact_row(FrameHeader, found):
            return None
        return found

    def _find_unbuilt(self, within: Range) -> list[Range]:
        """Where not all patches have tiles of all samples, UTC ns, in whole tiles."""
        least = max(row["grain"] for row in self._compacted.values())
        built = [row["built"] for row in self._compacted.values()]
        if None in built or len(self._compacted) == 0:
            return [within]
        end = min(built) >> least << least
        s = stale_patch_chunks.c
        query = select(s.patch, s.chunk).where(self._here(stale_patch_chunks))
        found = [(end, MOST_INSTANT)]
        for patch, chunk in self._connection.execute(query):
            if patch in self._compacted:
                bits = self._compacted[patch]["grain"] + PATCH_CHUNK
                found.append((chunk << bits, (chunk + 1) << bits))
        bits = least + PATCH_CHUNK
        for page, longest in self._longest.items():
            f = frames.c
            late = select(f.t, f.t_end).where(
                self._here(frames), f.page == page, f.t >= before(within[0], longest), f.t < end
            )
            for t, t_end in self._connection.execute(late):
                found.append((t >> bits << bits, ((t_end >> bits) + 1) << bits))
        tiles = refined(coarsened(found, least), least)
        return merged((max(a, within[0]), min(b, within[1])) for a, b in tiles)

    def _fold_tiles(self, part: _Tiles, grid: tuple[int, int], hulls: PictureHulls) -> None:
        t = patch_tiles.c
        query = select(t.patch, t.chunk, t.data, t.digest).where(
            self._here(patch_tiles),
            t.patch.in_(list(self._compacted)),
            t.level == part.level,
            t.chunk.between(part.first >> PATCH_CHUNK, (part.end - 1) >> PATCH_CHUNK),
        )
        within = part.first << part.level, part.end << part.level
        places: dict[tuple[bytes, ...], Integers] = {}
        for patch, number, data, digest in self._connection.execute(
            query.order_by(t.patch, t.chunk)
        ):
            place = Place(self._node, patch)
            chunk = read_chunk(self._connection, place, part.level, number, (data, digest))
            if chunk is None:
                continue
            if chunk.names not in places:
                taxels = taxels_of(self._connection, self._node, chunk)
                quantity = find_patch(self._connection, self._node, chunk.names[0]).quantity
                places[chunk.names] = np.array(
                    [self._channels.get(f"{taxel}.{quantity}", -1) for taxel in taxels]
                )
            fold_tiles(chunk, places[chunk.names], within, grid, hulls, spread=self._spread)
            self.coverage = min(self.coverage, float(chunk.times[COVERAGE].view(np.float64).min()))
            self.time_error = max(self.time_error, int(chunk.times[ERROR].max()))

    def _fold_samples(self, window: Window, grid: tuple[int, int], hulls: PictureHulls) -> None:
        self._fold_rows(window, grid, hulls)
        f, count = frames.c, 0
        for page, longest in self._longest.items():
            earliest = before(window.start, longest)
            query = select(func.count()).where(
                self._here(frames), f.page == page, f.t >= earliest, f.t < window.end
            )
            count += self._connection.execute(query).scalar_one()
        _require_few(count, MOST_FRAMES // self._share, "frames")
        for page, longest in self._longest.items():
            rows = read_frame_rows(self._connection, self._node, page, window, longest)
            for some in _batches(rows):
                records = self._scan(some)
                places = self._layouts[bytes(some[0]["layout"])]
                fold_records(records, places, grid, hulls, spread=self._spread)
                if len(records.whole):
                    self.coverage = min(self.coverage, float(records.coverage.min()))
                    self.time_error = max(self.time_error, *(row["error"] for row in some))

    def _fold_rows(self, window: Window, grid: tuple[int, int], hulls: PictureHulls) -> None:
        """Add the samples of compacted rows."""
        if not self._compacted:
            return
        longest = max(row["longest"] for row in self._compacted.values())
        p = patch_rows.c
        here = and_(
            self._here(patch_rows),
            p.patch.in_(list(self._compacted)),
            p.t >= before(window.start, longest),
            p.t < window.end,
            p.t_end >= window.start,
        )
        count = select(func.count()).where(here)
        _require_few(self._connection.execute(count).scalar_one(), MOST_ROWS // self._share, "rows")
        query = select(patch_rows).where(here).order_by(p.patch, p.t, p.boot, p.sequence)
        places: dict[bytes, ColumnPlaces] = {}
        for row in self._connection.execute(query).mappings():
            if not is_intact_row(PatchRowHeader, row):
                continue
            runs = decode_matrix(row["data"])
            name = runs.patch
            if name not in places:
                places[name] = self._place([find_patch(self._connection, self._node, name)])
            fold_matrix(runs, places[name], grid, hulls, spread=self._spread)
            self.coverage = min(self.coverage, row["coverage"])
            self.time_error = max(self.time_error, row["error"])

    def _here(self, table: Table) -> ColumnElement[bool]:
        return of_node(table, self._node)

    def _is_in(self, row: RowMapping) -> bool:
        """Whether a patch has a channel of the pictures."""
        patch = find_patch(self._connection, self._node, bytes(row["hash"]))
        return any(channel in self._channels for channel in patch.channels)

    def _place(self, described: Sequence[Patch]) -> ColumnPlaces:
        places = ColumnPlaces.empty(len(described))
        for number, patch in enumerate(described):
            columns = len(patch.taxels)
            places.channel[number, :columns] = [
                self._channels.get(name, -1) for name in patch.channels
            ]
            if patch.skew:
                places.skew[number, :columns] = patch.skew
        return places

    def _scan(self, rows: Sequence[RowMapping]) -> Records:
        """Decode frames of one layout."""
        wanted = np.any(self._layouts[bytes(rows[0]["layout"])].channel >= 0, axis=1)
        return scan_frames([row["data"] for row in rows], wanted)


def choose_pictures(readers: Sequence[PictureReader], window: Window, points: int) -> Buckets:
    """At most ``points`` pictures of a window, each 1.5 sampling periods long at least.

    They are tiles if the window has a quarter as many, because to decode so long a window costs
    more than it shows.

    Args:
        readers: Of all channels.
        window: The window.
        points: Most pictures.
    """
    grains = [reader.grain for reader in readers if not reader.is_silent]
    known = [grain for grain in grains if grain is not None]
    grain = max(known, default=0)
    if not grains or len(known) < len(grains) or window.span >> grain < -(-points // _COARSER):
        step = max((reader.step(window) for reader in readers), default=1)
        width = max(bucket_width(window.span, points), step)
        return Buckets(window.start, width, -(-window.span // width))
    level = grain
    while level + STEP <= TOP and window.span >> (level + STEP) >= points:
        level += STEP
    first, end = window.start >> level, ((window.end - 1) >> level) + 1
    each = -(-(end - first) // points)
    return Buckets(first << level, each << level, -(-(end - first) // each))


def _require_few(count: int, most: int, what: str) -> None:
    if count > most:
        raise QueryError(
            "start",
            f"to end are {count} {what} that no tiles cover yet, and at most {most} are read for "
            "an answer; choose a shorter window, or ask again later",
        )


def _common(ranges: Sequence[Range], others: Sequence[Range]) -> list[Range]:
    """The intersection of ranges."""
    found = [(max(a, c), min(b, d)) for a, b in ranges for c, d in others]
    return [(first, end) for first, end in found if first < end]


def _batches(rows: Sequence[RowMapping]) -> Iterator[list[RowMapping]]:
    """Frames of one layout each, in order of time, not more than fit the memory."""
    for _, of_layout in groupby(rows, key=lambda row: bytes(row["layout"])):
        listed = list(of_layout)
        for begin in range(0, len(listed), _AT_ONCE):
            yield listed[begin : begin + _AT_ONCE]
