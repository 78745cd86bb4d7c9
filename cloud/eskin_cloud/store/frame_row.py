"""Rows of frames: their columns, and how one patch is read without the others."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final, NamedTuple, Self

import cbor2
import numpy as np

from eskin.errors import MessageError
from eskin.wire.frames import Grid, PatchSamples
from eskin.wire.messages.cbor_map import ARRAY, opening
from eskin.wire.timestamp import MOST_MOMENT
from eskin_cloud.store.damage import FrameHeader
from eskin_cloud.store.slot import slot_of

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from eskin.wire.frames import FrameSummary
    from eskin_cloud.store.descriptions import DescribedLayout

PATCH_BOUNDS: Final = np.dtype(
    [("patch", "<u2"), ("offset", "<u4"), ("length", "<u4"), ("lo", "<f8"), ("hi", "<f8")]
)
"""An item of column ``bounds``: a patch's number in the layout, where its CBOR item stands in
``data``, and the hull of its samples; infinite where a sample is unknown on that side."""
_NAMES: Final = list(PATCH_BOUNDS.names or ())
_MAP_OF_8: Final = b"\xa8"


class FrameHead(NamedTuple):
    """A frame without its patches.

    Attributes:
        ticks: The node's clock at the first moment, ns since its start.
        time: Enclosure of the same moment, UTC ns.
        grids: When patches were sampled.
    """

    ticks: int
    time: tuple[int, int]
    grids: tuple[Grid, ...]


class FrameRow(NamedTuple):
    """The columns of `eskin_cloud.store.schema.frame_tables.frames`, in their order."""

    slot: int
    node: str
    boot: int
    sequence: int
    cursor: int
    layout: bytes
    page: int
    t: int
    t_end: int
    error: int
    t_lo: int
    t_hi: int
    samples: int
    received: int
    data: bytes
    bounds: bytes
    digest: bytes
    head: int | None

    @classmethod
    def of(
        cls,
        node: str,
        frame: FrameSummary,
        span: tuple[int, int],
        data: bytes,
        digest: bytes,
        *,
        cursor: int,
        now: int,
    ) -> Self:
        """The row of a frame.

        Args:
            node: The node.
            frame: The decoded frame.
            span: As `find_span` gives it.
            data: Its bytes.
            digest: Digest of ``data``.
            cursor: Its cursor in the feed.
            now: UTC ns.
        """
        (boot, sequence), layout, page, _, (t_lo, t_hi), _, records = frame
        middle, error = (t_lo + t_hi) // 2, (t_hi - t_lo + 1) // 2
        t, t_end = middle + span[0], middle + span[1]
        samples, bounds = int(records["samples"].sum()), _pack_bounds(records)
        head = FrameHeader(node, boot, sequence, layout, page, t, t_end, error, t_lo, t_hi,
                           samples, bounds, digest)  # fmt: skip
        return cls(slot_of(node), node, boot, sequence, cursor, layout, page, t, t_end, error,
                   t_lo, t_hi, samples, now, data, bounds, digest, head.checksum())  # fmt: skip

    @property
    def last_time(self) -> tuple[int, int]:
        """Enclosure of the last sample's time, UTC ns."""
        after = self.t_end - (self.t_lo + self.t_hi) // 2
        return self.t_lo + after, self.t_hi + after


def read_patch_bounds(data: bytes) -> NDArray[Any]:
    """The items of column ``bounds``: a `PATCH_BOUNDS` for each patch, patches ascending."""
    return np.frombuffer(data, PATCH_BOUNDS)


def patch_record(data: bytes, bounds: NDArray[Any], patch: int) -> PatchSamples | None:
    """The samples of one patch, which stay encoded; ``None`` if the frame has none of it.

    Args:
        data: Column ``data`` of an intact row.
        bounds: As `read_patch_bounds` gives them.
        patch: Its number in the layout.
    """
    at = int(np.searchsorted(bounds["patch"], patch))
    if at == len(bounds) or bounds["patch"][at] != patch:
        return None
    return _read_item(data, bounds[at])


def read_frame_head(data: bytes, bounds: NDArray[Any]) -> FrameHead:
    """What stands in a frame before its patches.

    Args:
        data: Column ``data`` of an intact row.
        bounds: As `read_patch_bounds` gives them.
    """
    # The patches are the last field: key 9 and the head of the array precede the first.
    end = int(bounds["offset"][0]) - len(opening(ARRAY, len(bounds))) - 1
    fields = cbor2.loads(_MAP_OF_8 + data[1:end])
    return FrameHead(fields[6], tuple(fields[7]), tuple(Grid(*grid) for grid in fields[8]))


def find_span(frame: FrameSummary, described: DescribedLayout, data: bytes) -> tuple[int, int]:
    """From a frame's first moment to its first and to its last sample, ns.

    Args:
        frame: The decoded frame.
        described: The layout that it fits.
        data: Its bytes.

    Raises:
        MessageError: The last sample's time does not fit into 64 bit.
    """
    records = frame.records
    spans = []
    if records["strided"].any():
        strided = records[records["strided"] != 0]
        spans += [_strided_span(frame, described, data, record) for record in strided]
        records = records[records["strided"] == 0]
    if len(records):
        patches, grids = records["patch"], records["grid"]
        begins = np.array([grid.delay for grid in frame.grids])
        ends = np.array([grid.delay + grid.period * (grid.rows - 1) for grid in frame.grids])
        first = begins[grids] + described.least_skew[patches]
        last = ends[grids] + described.most_skew[patches]
        spans.append((int(first.min()), int(last.max())))
    first, last = min(each[0] for each in spans), max(each[1] for each in spans)
    if frame.time[1] + last > MOST_MOMENT:
        raise MessageError(
            f"last sample lies after the year 2262: field 7 is {list(frame.time)}, and it was "
            f"taken {last} ns later"
        )
    return first, last


def _strided_span(
    frame: FrameSummary, described: DescribedLayout, data: bytes, record: Any
) -> tuple[int, int]:
    """The same for a patch of which not every row has a sample of each column."""
    samples = _read_item(data, record)
    grid, skew = frame.grids[samples.grid], described.patches[samples.patch].skew
    mask = samples.sampling(grid).mask
    rows = grid.delay + np.arange(grid.rows, dtype=np.int64)[:, np.newaxis] * grid.period
    times = (rows + np.array(skew or (0,) * samples.columns, np.int64))[mask]
    return int(times.min()), int(times.max())


def _read_item(data: bytes, place: Any) -> PatchSamples:
    """The samples whose item stands at the ``offset`` and has the ``length`` of a place."""
    begin = int(place["offset"])
    return PatchSamples.read(cbor2.loads(data[begin : begin + int(place["length"])]))


def _pack_bounds(records: NDArray[Any]) -> bytes:
    packed = np.empty(len(records), PATCH_BOUNDS)
    for name in _NAMES:
        packed[name] = records[name]
    return packed.tobytes()
