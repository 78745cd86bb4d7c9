"""The hull of each column's samples in a frame, in one compiled look."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from eskin.kernels.jit import kernel
from eskin.wire.frames.sample_codec import MOST_STRIDE, PADDING, decode_codes, order_cells
from eskin.wire.messages.compiled_cbor import read_head, read_integer, read_string

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from eskin.interval import Floats
    from eskin.wire.frames.frame_summary import FrameSummary


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
    def of(cls, data: bytes, summary: FrameSummary) -> ColumnHulls:
        """The hulls of a frame.

        Args:
            data: The frame.
            summary: The same, as `FrameSummary.decode` found it.
        """
        size = int(summary.records["columns"].sum())
        lo, hi, samples = np.full(size, np.inf), np.full(size, -np.inf), np.zeros(size, np.int64)
        rows = np.array([(grid.first_row % 2**MOST_STRIDE, grid.rows) for grid in summary.grids])
        padded = np.frombuffer(data + bytes(PADDING), np.uint8)
        _enclose(padded, summary.records, rows, lo, hi, samples)
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
    first = 0
    cells, ordered = order_cells(0, 0, 0, np.zeros(0, np.uint8)), (0, 0)
    for k in range(len(records)):
        record = records[k]
        columns = int(record.columns)
        first_row, rows = grids[record.grid]
        place = int(record.offset) + 1
        for _ in range(4):  # patch, grid, epoch, columns
            _, place = read_head(data, place, 0)
        exponent, place = read_integer(data, place)
        offset, place = read_integer(data, place)
        codes, end = read_string(data, place, 2)
        if record.strided:
            strides, _ = read_string(data, end + 2, 2)  # after the head of the options and a key
            cells = order_cells(rows, columns, first_row, data[strides : strides + columns])
            ordered = (0, 0)
        elif ordered != (rows, columns):
            cells = order_cells(rows, columns, 0, np.zeros(columns, np.uint8))
            ordered = (rows, columns)
        low, high = np.full(rows * columns, -np.inf), np.full(rows * columns, np.inf)
        decode_codes(data, (codes, end), cells, (exponent, offset), low, high)
        order = cells[0]
        for n in range(len(order)):
            cell = order[n, 0]
            column = first + cell % columns
            lo[column], hi[column] = min(lo[column], low[cell]), max(hi[column], high[cell])
            samples[column] += 1
        first += columns
