"""Read patches of many frames in one compiled pass.

`Frame.decode` checks a frame, and makes an object of each part. A store that keeps checked frames
reads them again by the thousand; this module reads only what is asked for of each.
"""

from __future__ import annotations

from enum import IntEnum
from typing import TYPE_CHECKING, Any, Final, NamedTuple, TypeAlias

import numpy as np

from eskin.errors import MessageError
from eskin.kernels.jit import kernel, part
from eskin.wire.frames.frame import MOST_GRIDS
from eskin.wire.frames.sample_codec import (
    MOST_COLUMNS,
    MOST_STRIDE,
    PADDING,
    decode_codes,
    order_cells,
)
from eskin.wire.messages.compiled_cbor import (
    NOWHERE,
    read_count,
    read_head,
    read_integer,
    read_key,
    read_pair,
    read_real,
    read_string,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from eskin.interval import Floats

    Integers: TypeAlias = NDArray[np.int64]
    Bytes: TypeAlias = NDArray[np.uint8]


class Part(IntEnum):
    """Columns of `Records.whole`."""

    FRAME = 0
    """Number of the frame among those that were given."""
    PATCH = 1
    TICKS = 2
    EARLIEST = 3
    LATEST = 4
    DELAY = 5
    PERIOD = 6
    FIRST_ROW = 7
    ROWS = 8
    EPOCH = 9
    COLUMNS = 10
    EXPONENT = 11
    OFFSET = 12
    CODES = 13
    CODES_END = 14
    STRIDES = 15
    """Where the strides stand, or -1."""
    UNSHARED = 16
    """Where the bits of unshared columns stand, or -1."""
    BEGIN = 17
    """Number of the record's first cell among all cells; a row follows the other."""


_FRAME, _PATCH, _TICKS, _EARLIEST, _LATEST, _DELAY, _PERIOD, _FIRST_ROW, _ROWS, _EPOCH = range(10)
_COLUMNS, _EXPONENT, _OFFSET, _CODES, _CODES_END, _STRIDES, _UNSHARED, _BEGIN = range(10, 18)
PARTS: Final = 18


class Records(NamedTuple):
    """Samples of patches, a record for each patch of each frame.

    Attributes:
        data: All frames, one after the other.
        whole: Integers of each record (`Part`), shape ``(records, 18)``; places count in ``data``.
        coverage: Of each record.
        lo: Lower bounds of all records, each row after row; infinite where nothing is known.
        hi: Upper bounds.
    """

    data: Bytes
    whole: Integers
    coverage: Floats
    lo: Floats
    hi: Floats

    def strides(self, record: int) -> bytes:
        """The strides of a record's columns; empty where all are sampled in each row."""
        place = int(self.whole[record, Part.STRIDES])
        if place < 0:
            return b""
        return self.data[place : place + int(self.whole[record, Part.COLUMNS])].tobytes()

    def unshared(self, record: int) -> tuple[int, ...]:
        """The columns of a record that have no shared error."""
        place = int(self.whole[record, Part.UNSHARED])
        if place < 0:
            return ()
        columns = int(self.whole[record, Part.COLUMNS])
        octets = self.data[place : place + (columns + 7) // 8]
        return tuple(np.flatnonzero(np.unpackbits(octets, bitorder="little")).tolist())


def scan_frames(frames: Sequence[bytes], wanted: NDArray[np.bool_]) -> Records:
    """Read the records of some patches, in the order of the frames and their patches.

    Args:
        frames: As `Frame.decode` accepts them; anything else has undefined results.
        wanted: For each patch of the layout, whether it is read.

    Raises:
        MessageError: Codes are not those of samples.
    """
    sizes = np.fromiter(map(len, frames), np.int64, len(frames))
    starts = np.concatenate([[0], np.cumsum(sizes)])
    data = np.frombuffer(b"".join([*frames, bytes(PADDING)]), np.uint8)
    room = len(frames) * int(np.count_nonzero(wanted))
    whole, coverage = np.empty((room, PARTS), np.int64), np.empty(room)
    count, cells = _scan(data, starts, wanted, whole, coverage)
    whole, coverage = whole[:count], coverage[:count]
    lo, hi = np.full(cells, -np.inf), np.full(cells, np.inf)
    faulty = _decode_records(data, whole, lo, hi)
    if faulty >= 0:
        _, patch, *_ = whole[faulty].tolist()
        raise MessageError(f"field 9, patch {patch}: codes cannot be read")
    return Records(data, whole, coverage, lo, hi)


@kernel
def _scan(
    data: Bytes, starts: Integers, wanted: NDArray[np.bool_], whole: Integers, coverage: Floats
) -> tuple[int, int]:
    """Find the records; gives how many, and their cells."""
    last = wanted.size - 1
    while last >= 0 and not wanted[last]:
        last -= 1
    grids, surely = np.empty((MOST_GRIDS, 4), np.int64), np.empty(MOST_GRIDS)
    head, row = np.empty(4, np.int64), np.empty(PARTS, np.int64)
    count = cells = 0
    for frame in range(starts.size - 1):
        at = _read_frame(data, int(starts[frame]), head, grids, surely)
        row[_FRAME] = frame
        row[_TICKS : _LATEST + 1] = head[1:]
        for _ in range(head[0]):
            grid, at = read_record(data, at, row)
            if row[_PATCH] > last:
                break
            if wanted[row[_PATCH]]:
                row[_DELAY : _ROWS + 1] = grids[grid]
                row[_BEGIN] = cells
                whole[count], coverage[count] = row, surely[grid]
                cells += row[_ROWS] * row[_COLUMNS]
                count += 1
    return count, cells


@part
def _read_frame(data: Bytes, place: int, head: Integers, grids: Integers, surely: Floats) -> Any:
    """Read a frame up to its patches: their number, ticks, the earliest and the latest instant."""
    place += 1  # the map's head
    for key in range(1, 4):  # kind, boot, sequence
        _, place = read_count(data, place, key)
    _, place = read_string(data, read_key(data, place, 4), 2)  # layout
    _, place = read_count(data, place, 5)  # page
    head[1], place = read_head(data, read_key(data, place, 6), 0)  # ticks
    head[2], place = read_integer(data, read_pair(data, place, 7))
    head[3], place = read_integer(data, place)
    size, place = read_head(data, read_key(data, place, 8), 4)
    for grid in range(size):
        _, place = read_head(data, place, 4)
        for k in range(4):
            grids[grid, k], place = read_head(data, place, 0)
        surely[grid], place = read_real(data, place)
    head[0], place = read_head(data, read_key(data, place, 9), 4)
    return place


@part
def read_record(data: Bytes, place: int, row: Integers) -> tuple[Any, Any]:
    """Read a patch, whose codes stay encoded; gives its grid, and where the next one begins."""
    items, place = read_head(data, place, 4)
    row[_PATCH], place = read_head(data, place, 0)
    grid, place = read_head(data, place, 0)
    row[_EPOCH], place = read_head(data, place, 0)
    row[_COLUMNS], place = read_head(data, place, 0)
    row[_EXPONENT], place = read_integer(data, place)
    row[_OFFSET], place = read_integer(data, place)
    row[_CODES], place = read_string(data, place, 2)
    row[_CODES_END] = place
    row[_STRIDES] = row[_UNSHARED] = NOWHERE
    if items == 8:
        options, place = read_head(data, place, 5)
        for _ in range(options):
            key, place = read_head(data, place, 0)
            begin, place = read_string(data, place, 2)
            row[_STRIDES if key == 1 else _UNSHARED] = begin
    return grid, place


@kernel
def _decode_records(data: Bytes, whole: Integers, lo: Floats, hi: Floats) -> int:
    """Decode all records; gives the first that cannot be read, or -1."""
    even = np.zeros(MOST_COLUMNS, np.uint8)
    cells = order_cells(1, 1, 0, even[:1])
    shape = (0, 0)
    for record in range(len(whole)):
        row = whole[record]
        rows, columns, place = row[_ROWS], row[_COLUMNS], row[_STRIDES]
        if place >= 0:
            cells = order_cells(
                rows, columns, row[_FIRST_ROW] % 2**MOST_STRIDE, data[place : place + columns]
            )
            shape = (0, 0)
        elif shape != (rows, columns):
            cells = order_cells(rows, columns, 0, even[:columns])
            shape = (rows, columns)
        begin, end = row[_BEGIN], row[_BEGIN] + rows * columns
        within, scale = (row[_CODES], row[_CODES_END]), (row[_EXPONENT], row[_OFFSET])
        fault, _ = decode_codes(data, within, cells, scale, lo[begin:end], hi[begin:end])
        if fault:
            return record
    return -1
