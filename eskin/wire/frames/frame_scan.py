"""Read patches of many frames in one compiled pass.

`Frame.decode` checks a frame, and makes an object of each part. A store that keeps checked frames
reads them again by the thousand; this module reads only what is asked for of each.
"""

from __future__ import annotations

from enum import IntEnum
from typing import TYPE_CHECKING, Any, Final, NamedTuple, TypeAlias

import numpy as np

from eskin.errors import MessageError
from eskin.kernels.intrinsics import from_bits
from eskin.kernels.jit import kernel, part
from eskin.wire.frames.sample_codec import PADDING, decode_codes, order_cells

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from eskin.interval import Floats

    Integers: TypeAlias = NDArray[np.int64]
    Bytes: TypeAlias = NDArray[np.uint8]

_MOST_GRIDS: Final = 16
_WIDE_ROWS: Final = 2**16


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
_PARTS: Final = 18


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
    whole, coverage = np.empty((room, _PARTS), np.int64), np.empty(room)
    count, cells = _scan(data, starts, wanted, whole, coverage)
    whole, coverage = whole[:count], coverage[:count]
    lo, hi = np.full(cells, -np.inf), np.full(cells, np.inf)
    faulty = _decode_records(data, whole, lo, hi)
    if faulty >= 0:
        _, patch, *_ = whole[faulty].tolist()
        raise MessageError(f"field 9, patch {patch}: codes cannot be read")
    return Records(data, whole, coverage, lo, hi)


@part
def _head(data: Bytes, at: int) -> tuple[Any, Any]:
    """The argument of a CBOR item's head, and where what follows it begins."""
    short = np.int64(data[at] & 31)
    if short < 24:
        return short, at + 1
    size = 1 << (short - 24)
    value = np.int64(0)
    for k in range(at + 1, at + 1 + size):
        value = (value << 8) | np.int64(data[k])
    return value, at + 1 + size


@part
def _integer(data: Bytes, at: int) -> tuple[Any, Any]:
    value, after = _head(data, at)
    return (-1 - value if data[at] >> 5 == 1 else value), after


@part
def _skip_octets(data: Bytes, at: int) -> Any:
    size, begin = _head(data, at)
    return begin + size


@kernel
def _scan(
    data: Bytes, starts: Integers, wanted: NDArray[np.bool_], whole: Integers, coverage: Floats
) -> tuple[int, int]:
    """Find the records; gives how many, and their cells."""
    last = wanted.size - 1
    while last >= 0 and not wanted[last]:
        last -= 1
    grids, surely = np.empty((_MOST_GRIDS, 4), np.int64), np.empty(_MOST_GRIDS)
    head, row = np.empty(4, np.int64), np.empty(_PARTS, np.int64)
    count = cells = 0
    for frame in range(starts.size - 1):
        at = _read_frame(data, int(starts[frame]), head, grids, surely)
        row[_FRAME] = frame
        row[_TICKS : _LATEST + 1] = head[1:]
        for _ in range(head[0]):
            grid, at = _read_record(data, at, row)
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
def _read_frame(data: Bytes, at: Any, head: Integers, grids: Integers, surely: Floats) -> Any:
    """Read a frame up to its patches: their number, ticks, the earliest and the latest moment."""
    at += 2  # the map's head, and key 1
    for _ in range(3):  # kind, boot, sequence, each before the next key
        _, at = _integer(data, at)
        at += 1
    at = _skip_octets(data, at) + 1  # layout
    _, at = _integer(data, at)  # page
    head[1], at = _integer(data, at + 1)
    _, at = _head(data, at + 1)
    head[2], at = _integer(data, at)
    head[3], at = _integer(data, at)
    size, at = _head(data, at + 1)
    for grid in range(size):
        _, at = _head(data, at)
        for k in range(4):
            grids[grid, k], at = _integer(data, at)
        bits = np.int64(0)
        for k in range(at + 1, at + 9):
            bits = (bits << 8) | np.int64(data[k])
        surely[grid] = from_bits(bits)
        at += 9
    head[0], at = _head(data, at + 1)
    return at


@part
def _read_record(data: Bytes, at: int, row: Integers) -> tuple[Any, Any]:
    """Read a patch, whose codes stay encoded; gives its grid, and where the next one begins."""
    items, at = _head(data, at)
    row[_PATCH], at = _integer(data, at)
    grid, at = _integer(data, at)
    row[_EPOCH], at = _integer(data, at)
    row[_COLUMNS], at = _integer(data, at)
    row[_EXPONENT], at = _integer(data, at)
    row[_OFFSET], at = _integer(data, at)
    size, row[_CODES] = _head(data, at)
    at = row[_CODES_END] = row[_CODES] + size
    row[_STRIDES] = row[_UNSHARED] = -1
    if items == 8:
        options, at = _head(data, at)
        for _ in range(options):
            key, at = _integer(data, at)
            size, begin = _head(data, at)
            row[_STRIDES if key == 1 else _UNSHARED] = begin
            at = begin + size
    return grid, at


@kernel
def _decode_records(data: Bytes, whole: Integers, lo: Floats, hi: Floats) -> int:
    """Decode all records; gives the first that cannot be read, or -1."""
    even = np.zeros(64, np.uint8)
    cells = order_cells(1, 1, 0, even[:1])
    shape = (0, 0)
    for record in range(len(whole)):
        row = whole[record]
        rows, columns, place = row[_ROWS], row[_COLUMNS], row[_STRIDES]
        if place >= 0:
            cells = order_cells(
                rows, columns, row[_FIRST_ROW] % _WIDE_ROWS, data[place : place + columns]
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
