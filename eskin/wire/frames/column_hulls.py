"""The hull of each column's samples in a frame, in one compiled look."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from eskin.kernels.jit import kernel, part
from eskin.wire.frames.encoded_frame import without_others
from eskin.wire.frames.frame_scan import PARTS, Part, read_record
from eskin.wire.frames.sample_codec import MOST_STRIDE, PADDING, decode_codes, order_cells

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from eskin.interval import Floats
    from eskin.wire.frames.encoded_frame import EncodedFrame


class ColumnHulls(NamedTuple):
    """Hulls of columns, those of all patches of a frame one after the other.

    Attributes:
        lo: The least lower bound; infinite without samples.
        hi: The greatest upper bound; minus infinite without samples.
        samples: How many a column has.
    """

    lo: Floats
    hi: Floats
    samples: NDArray[np.int64]

    @classmethod
    def of(cls, frame: EncodedFrame) -> ColumnHulls:
        """The hulls of a frame."""
        size = int(frame.records["columns"].sum())
        lo, hi, samples = np.full(size, np.inf), np.full(size, -np.inf), np.zeros(size, np.int64)
        rows = np.array([(grid.first_row % 2**MOST_STRIDE, grid.rows) for grid in frame.grids])
        padded = np.frombuffer(frame.data + bytes(PADDING), np.uint8)
        _enclose(padded, frame.records, rows, lo, hi, samples)
        return cls(lo, hi, samples)


@kernel
def _enclose(
    data: NDArray[np.uint8],
    records: NDArray[Any],
    grids: NDArray[np.int64],
    lo: Floats,
    hi: Floats,
    samples: NDArray[np.int64],
) -> None:
    first, row = 0, np.empty(PARTS, np.int64)
    cells, ordered = order_cells(0, 0, 0, np.zeros(0, np.uint8)), (0, 0)
    column_of = _columns(cells[0], 1)
    for k in range(len(records)):
        record = records[k]
        columns = int(record.columns)
        first_row, rows = grids[record.grid]
        read_record(data, int(record.offset), row)
        strides = row[Part.STRIDES]
        if strides >= 0:
            cells = order_cells(rows, columns, first_row, data[strides : strides + columns])
            column_of = _columns(cells[0], columns)
            cells, ordered = without_others(cells, rows * columns), (0, 0)
        elif ordered != (rows, columns):
            cells = order_cells(rows, columns, 0, np.zeros(columns, np.uint8))
            column_of = _columns(cells[0], columns)
            cells, ordered = without_others(cells, rows * columns), (rows, columns)
        size = len(column_of)
        low, high = np.full(size, -np.inf), np.full(size, np.inf)
        within, scale = (
            (row[Part.CODES], row[Part.CODES_END]),
            (row[Part.EXPONENT], row[Part.OFFSET]),
        )
        decode_codes(data, within, cells, scale, low, high)
        for n in range(size):
            column = first + column_of[n]
            lo[column], hi[column] = min(lo[column], low[n]), max(hi[column], high[n])
            samples[column] += 1
        first += columns


@part
def _columns(order: NDArray[np.int32], columns: int) -> NDArray[np.int64]:
    """The column of each cell."""
    found = np.empty(len(order), np.int64)
    for k in range(len(order)):
        found[k] = order[k, 0] % columns
    return found
