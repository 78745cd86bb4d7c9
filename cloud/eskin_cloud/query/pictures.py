"""Pictures of a skin: hulls of all channels of one quantity, over neighbouring stretches of time.

A picture is the hull of the samples of each channel in ``[t, t + dt)``, whichever clock they were
taken by. Pictures are read under the latest layout of their window; samples of other layouts are
those of the channels with the same names.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import groupby
from typing import TYPE_CHECKING, Final

import numpy as np
from sqlalchemy import func, select

from eskin.errors import QueryError
from eskin.union_bound import union_coverage
from eskin.wire.frames.frame_scan import Part, scan_frames
from eskin.wire.timestamp import MOST_MOMENT
from eskin_cloud.rollup.blocks import Buckets
from eskin_cloud.rollup.hulls import bucket_width
from eskin_cloud.rollup.picture_fold import (
    ColumnPlaces,
    PictureHulls,
    close_gaps,
    fold_records,
)
from eskin_cloud.store.damage import FrameHeader, is_intact_frame
from eskin_cloud.store.descriptions import find_layout
from eskin_cloud.store.read.lookup import UnknownChannelError
from eskin_cloud.store.read.patch_runs import find_layouts, read_frame_rows, read_pages
from eskin_cloud.store.read.window import Window, before
from eskin_cloud.store.schema.frame_tables import frames
from eskin_cloud.store.slot import slot_of

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.typing import NDArray
    from sqlalchemy import Connection, RowMapping

    from eskin.interval import Floats
    from eskin.wire.frames import DescribedLayout, Patch
    from eskin.wire.frames.frame_scan import Records
    from eskin_cloud.rollup.aggregates import Integers

MOST_FRAMES: Final = 5000
"""Most frames that are decoded for an answer."""
MOST_VALUES: Final = 4_000_000
"""Most channels times pictures of an answer."""
_AT_ONCE: Final = 128


@dataclass(frozen=True, slots=True)
class Pictures:
    """Pictures of a skin.

    Attributes:
        node: The node.
        described: The layout by which they are read.
        quantity: The quantity.
        unit: UCUM code.
        patches: Numbers of the patches of the quantity; the channels are their columns, in order.
        taxels: Of each channel.
        buckets: When the pictures are: each is the hull of the samples in its bucket.
        lo: Lower bounds, shape ``(pictures, channels)``; infinite where nothing is known.
        hi: Upper bounds.
        contact: Whether each taxel was pressed at some time: 0 impossible, 1 possible, 2 certain;
            ``None`` if no patch states a threshold.
        coverage: Probability that a hull encloses all its true values.
        time_error: Greatest distance of a sample's true time from its stated time, ns.
    """

    node: str
    described: DescribedLayout
    quantity: str
    unit: str
    patches: tuple[int, ...]
    taxels: tuple[str, ...]
    buckets: Buckets
    lo: Floats
    hi: Floats
    contact: NDArray[np.uint8] | None
    coverage: float
    time_error: int

    @property
    def t(self) -> Integers:
        """When each picture begins, ns after the first."""
        return self.buckets.width * np.arange(self.buckets.count, dtype=np.int64)


def find_last(connection: Connection, node: str, *, sealed: bool = False) -> int | None:
    """The time of a node's last sample in frames, UTC ns; ``None`` if there is none.

    Unless ``sealed``, it does not depend on sealed frames, of which only the minute is known.
    """
    times = [
        row["t_last"]
        for row in read_pages(connection, node)
        if row["t_last"] is not None and (sealed or not _is_sealed(connection, node, row))
    ]
    return max(times, default=None)


def find_sealed(
    connection: Connection, node: str, window: Window, quantity: str | None
) -> list[tuple[DescribedLayout, int]]:
    """The biometric pages whose channels are in pictures of a node's skin, by their layouts."""
    chosen = quantity or _find_layout_of(connection, node, window).patches[0].quantity
    found = []
    for row in read_pages(connection, node):
        described = find_layout(connection, node, bytes(row["layout"]))
        if row["page"] in described.biometric_pages:
            numbers = described.page_ranges[row["page"]]
            if any(described.patches[number].quantity == chosen for number in numbers):
                found.append((described, row["page"]))
    return found


def _is_sealed(connection: Connection, node: str, page: RowMapping) -> bool:
    described = find_layout(connection, node, bytes(page["layout"]))
    return page["page"] in described.biometric_pages


def read_pictures(
    connection: Connection,
    node: str,
    window: Window,
    *,
    points: int,
    quantity: str | None = None,
    decrypted: Connection | None = None,
) -> Pictures:
    """Read pictures of a node's skin.

    A picture lasts long enough for a sample of each channel: 1.5 sampling periods at least.

    Args:
        connection: In a read transaction.
        node: The node.
        window: The window.
        points: Most pictures.
        quantity: Which; else that of the layout's first patch.
        decrypted: A store in memory with the node's sealed frames, if they are read, too.

    Raises:
        UnknownChannelError: The node has no layout.
        QueryError: None of its patches has the quantity; or the answer, or what must be read for
            it, is too large.
        UnknownDescriptionError: A layout is damaged in the store.
    """
    described = _find_layout_of(connection, node, window)
    patches = described.patches
    chosen = patches[0].quantity if quantity is None else quantity
    numbers = tuple(k for k, patch in enumerate(patches) if patch.quantity == chosen)
    if not numbers:
        names = ", ".join(sorted({patch.quantity for patch in patches}))
        raise QueryError("quantity", f"{chosen!r} is that of no patch of {node}; it has {names}")
    units = sorted({patches[number].unit for number in numbers})
    if len(units) > 1:
        raise QueryError("quantity", f"{chosen!r} has several units: {', '.join(units)}")
    taxels = tuple(taxel for number in numbers for taxel in patches[number].taxels)
    if len(taxels) * points > MOST_VALUES:
        most = MOST_VALUES // len(taxels)
        raise QueryError("points", f"is {points}; {node} has {len(taxels)} taxels: at most {most}")
    sources = [connection] if decrypted is None else [connection, decrypted]
    reader = _FrameReader(sources, node, described, numbers)
    step = _longest_step(reader.period(window))
    width = max(bucket_width(window.span, points), step)
    buckets = Buckets(window.start, width, -(-window.span // width))
    hulls, coverage, error = reader.fold(buckets, step)
    seen = hulls.n > 0
    return Pictures(
        node=node,
        described=described,
        quantity=chosen,
        unit=units[0],
        patches=numbers,
        taxels=taxels,
        buckets=buckets,
        lo=np.where(seen, hulls.lo, -np.inf),
        hi=np.where(seen, hulls.hi, np.inf),
        contact=_contact(hulls, [patches[number] for number in numbers]),
        coverage=union_coverage(coverage, n=int(hulls.n.max(initial=0))),
        time_error=error,
    )


def _find_layout_of(connection: Connection, node: str, window: Window) -> DescribedLayout:
    """The latest layout of a window; of a node without frames up to its end, the latest one."""
    begun = [
        (row["t_first"], bytes(row["layout"]))
        for row in read_pages(connection, node)
        if row["t_first"] is not None and row["t_first"] < window.end
    ]
    if begun:
        return find_layout(connection, node, max(begun)[1])
    known = find_layouts(connection, node)
    if not known:
        raise UnknownChannelError(
            "node", f"{node} states no layout, so there is no picture of its skin"
        )
    return known[0]


def _contact(hulls: PictureHulls, patches: Sequence[Patch]) -> NDArray[np.uint8] | None:
    if all(patch.threshold is None for patch in patches):
        return None
    least = [np.nan if patch.threshold is None else patch.threshold for patch in patches]
    threshold = np.repeat(np.array(least), [len(patch.taxels) for patch in patches])
    unknown = (hulls.n == 0) | hulls.gap | np.isnan(threshold)
    possible = unknown | (hulls.hi > threshold)
    found: NDArray[np.uint8] = possible.astype(np.uint8) + (hulls.peak > threshold)
    return found


class _FrameReader:
    """Reads the frames that hold channels of pictures.

    Args:
        sources: Where frames are, each in a read transaction.
        node: The node.
        described: The layout of the pictures.
        numbers: Its patches that are in them.
    """

    def __init__(
        self,
        sources: Sequence[Connection],
        node: str,
        described: DescribedLayout,
        numbers: Sequence[int],
    ) -> None:
        self._node = node
        channels = (name for number in numbers for name in described.patches[number].channels)
        self._channels = {name: k for k, name in enumerate(channels)}
        self._places: dict[bytes, ColumnPlaces] = {}
        self._longest: dict[tuple[Connection, int], int] = {}
        for source in sources:
            for row in read_pages(source, node):
                other = find_layout(source, node, bytes(row["layout"]))
                if other.hash not in self._places:
                    self._places[other.hash] = self._place(other)
                numbers = other.layout.page_range(row["page"])
                here = self._places[other.hash].channel[numbers.start : numbers.stop]
                if np.any(here >= 0):
                    key = source, row["page"]
                    self._longest[key] = max(self._longest.get(key, 0), row["longest"])

    def period(self, window: Window) -> int:
        """The longest sampling period in the last frames of a window, ns; 1 without any."""
        found = 1
        for source, page in self._longest:
            row = self._last(source, page, window)
            if row is None:
                continue
            records = self._scan([row])
            for record, each in enumerate(records.whole.tolist()):
                stride = max(records.strides(record), default=0)
                found = max(found, each[Part.PERIOD] << stride)
        return found

    def fold(self, buckets: Buckets, margin: int) -> tuple[PictureHulls, float, int]:
        """Hulls of all frames, their least coverage, and their greatest time error.

        Args:
            buckets: When the pictures are.
            margin: How long before and after them frames are read, to know where gaps are, ns.

        Raises:
            QueryError: There are too many frames.
        """
        hulls = PictureHulls.empty(buckets.count, len(self._channels))
        grid = buckets.start, buckets.width
        coverage, error = 1.0, 0
        window = buckets.window
        wide = Window(before(window.start, margin), min(window.end + margin, MOST_MOMENT))
        self._require_few(wide)
        for (source, page), longest in self._longest.items():
            rows = read_frame_rows(source, self._node, page, wide, longest)
            for some in _batches(rows):
                records = self._scan(some)
                fold_records(records, self._places[bytes(some[0]["layout"])], grid, hulls)
                if len(records.whole):
                    coverage = min(coverage, float(records.coverage.min()))
                    error = max(error, *(row["error"] for row in some))
        close_gaps(grid, hulls)
        return hulls, coverage, error

    def _last(self, source: Connection, page: int, window: Window) -> RowMapping | None:
        """The last frame of a page that begins before a window's end, if it is intact."""
        f = frames.c
        query = select(frames).where(
            f.slot == slot_of(self._node), f.node == self._node, f.page == page, f.t < window.end
        )
        found = source.execute(query.order_by(f.t.desc()).limit(1)).mappings().first()
        if found is None or not is_intact_frame(
            found["data"], FrameHeader.of(found), found["head"]
        ):
            return None
        return found

    def _require_few(self, window: Window) -> None:
        f, count = frames.c, 0
        for (source, page), longest in self._longest.items():
            query = select(func.count()).where(
                f.slot == slot_of(self._node),
                f.node == self._node,
                f.page == page,
                f.t >= before(window.start, longest),
                f.t < window.end,
            )
            count += source.execute(query).scalar_one()
        if count > MOST_FRAMES:
            raise QueryError(
                "start",
                f"to end are {count} frames that no tiles cover yet, at most {MOST_FRAMES} are "
                "read for an answer; choose a shorter window, or ask again later",
            )

    def _place(self, described: DescribedLayout) -> ColumnPlaces:
        places = ColumnPlaces.empty(len(described.patches))
        for number, patch in enumerate(described.patches):
            columns = len(patch.taxels)
            places.channel[number, :columns] = [
                self._channels.get(name, -1) for name in patch.channels
            ]
            if patch.skew:
                places.skew[number, :columns] = patch.skew
        return places

    def _scan(self, rows: Sequence[RowMapping]) -> Records:
        """Decode frames of one layout."""
        places = self._places[bytes(rows[0]["layout"])]
        wanted = np.any(places.channel >= 0, axis=1)
        return scan_frames([row["data"] for row in rows], wanted)


def _longest_step(period: int) -> int:
    """The longest step to the next sample without a gap, ns."""
    return period + period // 2


def _batches(rows: Sequence[RowMapping]) -> Iterator[list[RowMapping]]:
    """Frames of one layout each, in order of time, not more than fit the memory."""
    for _, of_layout in groupby(rows, key=lambda row: bytes(row["layout"])):
        listed = list(of_layout)
        for begin in range(0, len(listed), _AT_ONCE):
            yield listed[begin : begin + _AT_ONCE]
