"""Frames and statements of thousands of nodes, compiled: what each node alone would write."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from eskin.kernels.jit import kernel, part
from eskin_sensor_node.firmware.assembler import MOST_PEAKS
from eskin_sensor_node.firmware.message_writer import FRAME, STATEMENTS
from eskin_sensor_node.fleet.report_kernels import GONE, Group, error_at
from eskin_sensor_node.machine.cbor import (
    ARRAY,
    BYTES,
    MAP,
    Scratch,
    begun,
    copied,
    head,
    integer,
    pair,
    real,
    scratch,
)

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from eskin.interval import Floats
    from eskin_sensor_node.machine.cbor import Bytes

    Integers = NDArray[np.int64]

RECORD: Final = np.dtype(
    [
        (name, np.int64)
        for name in ("row", "kind", "sequence", "earliest", "latest", "samples", "begin", "end")
    ]
)
"""One message: the node's row, what flash must know, and where its bytes lie."""
HEAD_BYTES: Final = 120
GRID_BYTES: Final = 48
PATCH_BYTES: Final = 120
"""More than each takes in a frame, besides codes: strides are a byte a column."""
PEAK_BYTES: Final = 140
"""More than a peak takes in a statement."""


class Writing(NamedTuple):
    """What messages of all nodes begin with.

    Attributes:
        layout: Hash of the layout.
        error: Greatest error of the clocks at tick 0, ns.
        drift: Greatest error of their crystals, in parts of 1e9.
    """

    layout: Bytes
    error: int
    drift: int


class Page(NamedTuple):
    """The matrices of one page, which are the same of all nodes but for their values.

    Attributes:
        number: Of the page.
        heads: Of each matrix: number of its patch, columns, ticks of the first row, ticks of the
            last row, number of its grid, epoch; matrices × 6.
        grids: Period, number of the first row, rows; grids × 3. Matrices of one grid have one
            start.
        coverages: Of each grid.
        strides: Of each matrix, of each column; matrices × columns, zeros where there are none.
        strided: Of each matrix, whether it has strides.
        samples: Of each matrix and node, how many samples are sent; matrices × nodes.
        exponents: Of each matrix and node.
        offsets: Likewise.
        begins: Where the codes of each matrix and node begin.
        ends: Where they end.
        codes: Codes of all.
    """

    number: int
    heads: Integers
    grids: Integers
    coverages: Floats
    strides: NDArray[np.uint8]
    strided: NDArray[np.bool_]
    samples: Integers
    exponents: Integers
    offsets: Integers
    begins: Integers
    ends: Integers
    codes: Bytes


@part
def _next(group: Group, row: int) -> int:
    node = group.numbers[row]
    sequence: int = group.nodes.sequences[node]
    group.nodes.sequences[node] = sequence + 1
    return sequence


@part
def _octets(out: Bytes, at: int, piece: Bytes) -> int:
    return copied(out, head(out, at, BYTES, piece.size), piece)


@part
def _write_patch(out: Bytes, at: int, page: Page, row: int, k: int, grid: int) -> int:
    patch, columns = page.heads[k, 0], page.heads[k, 1]
    at = head(out, at, ARRAY, 8 if page.strided[k] else 7)
    at = integer(out, integer(out, at, patch), grid)
    at = integer(out, integer(out, at, page.heads[k, 5]), columns)
    at = integer(out, integer(out, at, page.exponents[k, row]), page.offsets[k, row])
    at = _octets(out, at, page.codes[page.begins[k, row] : page.ends[k, row]])
    if page.strided[k]:
        at = integer(out, head(out, at, MAP, 1), 1)
        at = _octets(out, at, page.strides[k, :columns])
    return at


@part
def _survey(page: Page, row: int, place: Integers) -> tuple[int, int, int]:
    """Which matrices and grids a node's frame has.

    Args:
        page: The page.
        row: The node's.
        place: Takes the number of each grid in the frame, or -1.

    Returns:
        How many matrices, ticks of the first row, ticks of the last one.
    """
    first = last = patches = grids = 0
    place[:] = -1
    for k in range(len(page.heads)):
        if page.samples[k, row] == 0:
            continue
        start, end = page.heads[k, 2], page.heads[k, 3]
        first = start if patches == 0 else min(first, start)
        last = end if patches == 0 else max(last, end)
        patches += 1
        if place[page.heads[k, 4]] < 0:
            place[page.heads[k, 4]] = grids
            grids += 1
    return patches, first, last


@part
def _write_matrices(
    out: Bytes, at: int, page: Page, row: int, first: int, place: Integers, room: Scratch
) -> int:
    """Write grids in the order of their first use, then patches."""
    at = head(out, integer(out, at, 8), ARRAY, place.max() + 1)
    written = 0
    for k in range(len(page.heads)):
        grid = page.heads[k, 4]
        if page.samples[k, row] and place[grid] == written:
            at = _write_grid(out, at, page, page.heads[k, 2] - first, grid, room)
            written += 1
    at = head(out, integer(out, at, 9), ARRAY, int(np.count_nonzero(page.samples[:, row])))
    for k in range(len(page.heads)):
        if page.samples[k, row]:
            at = _write_patch(out, at, page, row, k, place[page.heads[k, 4]])
    return at


@kernel
def write_frames(
    page: Page, writing: Writing, group: Group, out: Bytes, records: Any
) -> tuple[int, int]:
    """Write the frames of one page; gives how many bytes, and how many frames."""
    room, at, count = scratch(), 0, 0
    place = np.empty(len(page.grids), np.int64)
    for row in range(group.numbers.size):
        node = group.numbers[row]
        patches, first, last = _survey(page, row, place)
        if node == GONE or patches == 0:
            continue
        error = error_at(writing.error, writing.drift, last)
        middle = group.nodes.readings[node] + first
        sequence, record = _next(group, row), records[count]
        record.row, record.kind, record.sequence = row, FRAME, sequence
        record.earliest, record.latest = middle - error, middle + error + last - first
        record.samples, record.begin = page.samples[:, row].sum(), at
        at = begun(out, at, FRAME, 9, group.nodes.boots[node], sequence)
        at = _octets(out, integer(out, at, 4), writing.layout)
        at = integer(out, integer(out, at, 5), page.number)
        at = integer(out, integer(out, at, 6), first)
        at = pair(out, at, 7, middle - error, middle + error)
        at = _write_matrices(out, at, page, row, first, place, room)
        record.end = at
        count += 1
    return at, count


@part
def _write_grid(out: Bytes, at: int, page: Page, delay: int, grid: int, room: Scratch) -> int:
    at = integer(out, head(out, at, ARRAY, 5), delay)
    for k in range(3):
        at = integer(out, at, page.grids[grid, k])
    return real(out, at, page.coverages[grid], room)


@part
def _write_peak(out: Bytes, at: int, peak: Any, room: Scratch) -> int:
    at = head(out, at, ARRAY, 8)
    at = integer(out, integer(out, at, peak.patch), peak.column)
    at = integer(out, head(out, at, ARRAY, 2), peak.earliest)
    at = integer(out, integer(out, at, peak.latest), peak.verdict)
    at = integer(out, head(out, at, ARRAY, 2), peak.fewest)
    at = head(out, integer(out, at, peak.most), ARRAY, 2)
    at = real(out, real(out, at, peak.height_inf, room), peak.height_sup, room)
    at = head(out, at, ARRAY, 2)
    at = real(out, real(out, at, peak.prominence_inf, room), peak.prominence_sup, room)
    return real(out, at, peak.coverage, room)


@kernel
def write_peaks(
    peaks: Any, writing: Writing, group: Group, out: Bytes, records: Any
) -> tuple[int, int]:
    """Write statements of peaks; gives how many bytes, and how many messages.

    Args:
        peaks: Sorted by rows, those of each in their order; of one subject.
        writing: What messages begin with.
        group: Which nodes.
        out: Room for bytes.
        records: Room for records.
    """
    room, at, count, begin = scratch(), 0, 0, 0
    while begin < peaks.size:
        row, end = peaks[begin].row, begin
        while end < peaks.size and peaks[end].row == row and end - begin < MOST_PEAKS:
            end += 1
        sequence, record = _next(group, row), records[count]
        record.row, record.kind, record.sequence = row, STATEMENTS, sequence
        record.earliest, record.latest = peaks[begin].earliest, peaks[begin].latest
        record.samples, record.begin = 0, at
        at = begun(out, at, STATEMENTS, 5, group.nodes.boots[group.numbers[row]], sequence)
        at = _octets(out, integer(out, at, 4), writing.layout)
        at = head(out, integer(out, at, 5), ARRAY, end - begin)
        for k in range(begin, end):
            record.earliest = min(record.earliest, peaks[k].earliest)
            record.latest = max(record.latest, peaks[k].latest)
            at = _write_peak(out, at, peaks[k], room)
        record.end = at
        begin = end
        count += 1
    return at, count
