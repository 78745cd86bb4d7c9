"""Rows of frames: their columns, and whether a frame fits its layout."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple, NoReturn, Self

import cbor2
import numpy as np

from eskin.errors import MessageError
from eskin.kernels.jit import kernel
from eskin.wire.frames import PatchSamples
from eskin.wire.slot import slot_of
from eskin.wire.timestamp import MOST_INSTANT
from eskin_cloud.store.damage import FrameHeader

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from eskin.wire.frames import DescribedLayout, EncodedFrame


class FittingFrame(NamedTuple):
    """What is known of a frame once it was compared with its layout.

    Attributes:
        first: From its first instant to its first sample, ns.
        last: The same to its last sample.
        samples: How many it has.
    """

    first: int
    last: int
    samples: int


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
    digest: bytes
    head: int | None

    @classmethod
    def of(
        cls,
        node: str,
        frame: EncodedFrame,
        fitting: FittingFrame,
        digest: bytes,
        *,
        cursor: int,
        now: int,
    ) -> Self:
        """The row of a frame.

        Args:
            node: The node.
            frame: The decoded frame.
            fitting: As `fit_frame` gives it.
            digest: Digest of its bytes.
            cursor: Its cursor in the feed.
            now: UTC ns.
        """
        boot, sequence = frame.position
        layout, page, (t_lo, t_hi) = frame.layout, frame.page, frame.time
        first, last, samples = fitting
        middle, error = (t_lo + t_hi) // 2, (t_hi - t_lo + 1) // 2
        t, t_end = middle + first, middle + last
        head = FrameHeader(node, boot, sequence, layout, page, t, t_end, error, t_lo, t_hi,
                           samples, digest)  # fmt: skip
        return cls(slot_of(node), node, boot, sequence, cursor, layout, page, t, t_end, error,
                   t_lo, t_hi, samples, now, frame.data, digest, head.checksum())  # fmt: skip

    @property
    def last_time(self) -> tuple[int, int]:
        """Enclosure of the last sample's time, UTC ns."""
        after = self.t_end - (self.t_lo + self.t_hi) // 2
        return self.t_lo + after, self.t_hi + after


def fit_frame(frame: EncodedFrame, described: DescribedLayout) -> FittingFrame:
    """Check that a frame fits its layout, as `eskin.wire.frames.Frame.require_layout` does.

    Args:
        frame: The decoded frame.
        described: The layout that it names.

    Raises:
        MessageError: It does not, or a sample's time does not fit into 64 bit.
    """
    if frame.page >= len(described.page_ranges):
        raise MessageError(f"page is {frame.page}; the layout has {len(described.page_ranges)}")
    records, page = frame.records, described.page_ranges[frame.page]
    times = np.array([(g.delay, g.delay + g.period * (g.rows - 1)) for g in frame.grids])
    at, first, last, samples = _fit(records, described.facts, (page.start, page.stop), times)
    if at >= 0:
        _refuse_patch(records[at], page, described)
    if records["strided"].any():
        strided = records[records["strided"] != 0]
        spans = [_strided_span(frame, described, record) for record in strided]
        first = min(first, *(each[0] for each in spans))
        last = max(last, *(each[1] for each in spans))
    if frame.time[1] + last > MOST_INSTANT:
        raise MessageError(
            f"last sample lies after the year 2262: field 7 is {list(frame.time)}, and it was "
            f"taken {last} ns later"
        )
    if frame.ticks + last > MOST_INSTANT or frame.time[0] - frame.ticks < -MOST_INSTANT:
        raise MessageError(
            f"field 6 is {frame.ticks}; the node's clock at the last sample, or its start in UTC, "
            "does not fit into 64 bit"
        )
    return FittingFrame(first, last, samples)


@kernel
def _fit(
    records: NDArray[Any],
    facts: NDArray[np.int64],
    page: tuple[int, int],
    times: NDArray[np.int64],
) -> tuple[int, int, int, int]:
    """The first patch that does not fit, or -1; first and last sample of patches without strides.

    The last number is how many samples there are.
    """
    first, last, samples = np.int64(2**62), np.int64(-1), np.int64(0)
    for k in range(len(records)):
        record = records[k]
        patch = record.patch
        if not page[0] <= patch < page[1]:
            return k, 0, 0, 0
        columns, shares_errors, least_skew, most_skew = facts[patch]
        if record.columns != columns or (record.epoch > 0 and shares_errors == 0):
            return k, 0, 0, 0
        samples += record.samples
        if record.strided == 0:
            first = min(first, times[record.grid, 0] + least_skew)
            last = max(last, times[record.grid, 1] + most_skew)
    return -1, int(first), int(last), int(samples)


def _refuse_patch(record: Any, page: range, described: DescribedLayout) -> NoReturn:
    """Raise an error that states why a patch does not fit."""
    patch = int(record["patch"])
    if patch not in page:
        raise MessageError(
            f"patch {patch} is not on this page, which has {page.start} to {page[-1]}"
        )
    columns = len(described.patches[patch].taxels)
    if record["columns"] != columns:
        raise MessageError(f"patch {patch} has {record['columns']} columns, not {columns}")
    raise MessageError(f"patch {patch} has an epoch, but no shared error")


def _strided_span(frame: EncodedFrame, described: DescribedLayout, record: Any) -> tuple[int, int]:
    """The same for a patch of which not every row has a sample of each column."""
    begin = int(record["offset"])
    samples = PatchSamples.read(cbor2.loads(frame.data[begin : begin + int(record["length"])]))
    grid, skew = frame.grids[samples.grid], described.patches[samples.patch].skew
    mask = samples.sampling(grid).mask
    rows = grid.delay + np.arange(grid.rows, dtype=np.int64)[:, np.newaxis] * grid.period
    times = (rows + np.array(skew or (0,) * samples.columns, np.int64))[mask]
    return int(times.min()), int(times.max())
