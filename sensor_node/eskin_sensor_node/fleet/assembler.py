"""Collects what a cohort measured in one stretch, and writes the frames of all its nodes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from eskin.wire.frames import Sampling, content_hash, encode_matrices
from eskin_sensor_node.fleet.frame_kernels import (
    GRID_BYTES,
    HEAD_BYTES,
    PATCH_BYTES,
    PEAK_BYTES,
    RECORD,
    Page,
    Writing,
    write_frames,
    write_peaks,
)
from eskin_sensor_node.fleet.report_kernels import GONE

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.typing import NDArray

    from eskin.interval import Floats
    from eskin_sensor_node.firmware.assembler import Patch as PlannedPatch
    from eskin_sensor_node.firmware.schedule import Frame
    from eskin_sensor_node.fleet.report_kernels import Group
    from eskin_sensor_node.machine.node_layout import NodeLayout


class ChannelStretch(NamedTuple):
    """What one channel of all nodes has of a stretch.

    Attributes:
        patch: Its patch.
        column: Its column there.
        frame: When it was sampled.
        coverage: Of one sample.
        lows: Lower bounds, nodes × samples.
        highs: Upper bounds.
        truth: True values.
        sent: Of which nodes the samples are sent.
    """

    patch: PlannedPatch
    column: int
    frame: Frame
    coverage: float
    lows: Floats
    highs: Floats
    truth: Floats
    sent: NDArray[np.bool_]


class Written(NamedTuple):
    """A message of one node.

    Attributes:
        row: The node's.
        kind: `FRAME` or `STATEMENTS`.
        sequence: Its number.
        body: Its bytes.
        time: UTC ns, from the earliest to the latest instant.
        samples: How many samples it holds.
        begin: Ticks of the first instant of a frame.
        end: Ticks after its last row.
        sizes: Number and samples of each patch, shape ``(patches, 2)``; empty for statements.
        values: True values, patch after patch, row after row; likewise.
    """

    row: int
    kind: int
    sequence: int
    body: bytes
    time: tuple[int, int]
    samples: int
    begin: int
    end: int
    sizes: NDArray[np.uint32]
    values: Floats


@dataclass(frozen=True, slots=True)
class _Matrix:
    """One patch of all nodes; the twin of `firmware.assembler.Matrix`."""

    patch: PlannedPatch
    parts: Sequence[ChannelStretch]
    start: int
    dt: int
    rows: int
    coverage: float

    @classmethod
    def of(cls, parts: Sequence[ChannelStretch]) -> _Matrix:
        start = min(part.frame.start for part in parts)
        dt = min(part.frame.dt for part in parts)
        last = max(part.frame.start + (part.frame.n - 1) * part.frame.dt for part in parts)
        coverage = min(part.coverage for part in parts)
        return cls(parts[0].patch, parts, start, dt, (last - start) // dt + 1, coverage)

    @property
    def last(self) -> int:
        return self.start + (self.rows - 1) * self.dt

    @property
    def grid(self) -> tuple[int, int, int, int, float]:
        """Start, period, number of the first row, rows, coverage."""
        return self.start, self.dt, self.start // self.dt, self.rows, self.coverage

    @property
    def strides(self) -> bytes:
        found = bytearray(self.patch.columns)
        for part in self.parts:
            found[part.column] = (part.frame.dt // self.dt).bit_length() - 1
        return bytes(found)

    @property
    def samples(self) -> NDArray[np.int64]:
        """How many samples each node sends."""
        each = [part.sent * part.frame.n for part in self.parts]
        return np.asarray(np.sum(each, axis=0, dtype=np.int64))

    def filled(self, name: str, empty: float) -> Floats:
        """Nodes × cells: a part's attribute where it is sent, else one value."""
        values = np.full((len(self.parts[0].sent), self.rows, self.patch.columns), empty)
        for part in self.parts:
            first, step = (part.frame.start - self.start) // self.dt, part.frame.dt // self.dt
            rows = slice(first, first + step * part.frame.n, step)
            given = np.where(part.sent[:, np.newaxis], getattr(part, name), empty)
            values[:, rows, part.column] = given
        return values.reshape(len(values), -1)


class CohortAssembler:
    """Collects parts and peaks until `flush` writes them, as `firmware.assembler` does for one.

    Args:
        layout: How the nodes' channels are described.
        error: Greatest error of the nodes' clocks at their start, ns.
        drift: Greatest error of their crystals, in parts of 1e9.
    """

    def __init__(self, layout: NodeLayout, *, error: int, drift: int) -> None:
        name = np.frombuffer(content_hash(layout.layout.encode()), np.uint8)
        self._writing = Writing(name, error, drift)
        self._subjects = [patch.subject or "" for patch in layout.patches]
        self._least_widths = [patch.least_width for patch in layout.patches]
        self._parts: dict[int, list[ChannelStretch]] = {}
        self._peaks: list[Any] = []

    def add(self, parts: Sequence[ChannelStretch], peaks: Any) -> None:
        """Take the channels of a taxel's frame, and peaks."""
        for part in parts:
            self._parts.setdefault(part.patch.number, []).append(part)
        if len(peaks):
            self._peaks.append(peaks)

    def flush(self, group: Group) -> Iterator[Written]:
        """Write what was taken: of each node a frame a page, then peaks of each subject."""
        pages: dict[int, list[_Matrix]] = {}
        for number in sorted(self._parts):
            matrix = _Matrix.of(self._parts[number])
            pages.setdefault(matrix.patch.page, []).append(matrix)
        peaks, self._parts, self._peaks = self._peaks, {}, []
        for page in sorted(pages):
            yield from self._write_page(page, pages[page], group)
        yield from self._write_peaks(peaks, group)

    def _write_page(
        self, number: int, matrices: Sequence[_Matrix], group: Group
    ) -> Iterator[Written]:
        page = self._page(number, matrices, group)
        nodes = len(group.numbers)
        size = HEAD_BYTES + GRID_BYTES * len(page.grids) + PATCH_BYTES * len(matrices)
        out = np.empty(nodes * size + len(page.codes), np.uint8)
        records = np.empty(nodes, RECORD)
        _, count = write_frames(page, self._writing, group, out, records)
        truth = [matrix.filled("truth", np.nan) for matrix in matrices]
        whole = np.concatenate(truth, axis=1)
        each = zip(matrices, truth, strict=True)
        sizes = np.array([(m.patch.number, t.shape[1]) for m, t in each], np.uint32)
        present = page.samples > 0
        starts, ends = page.heads[:, 2], page.heads[:, 3]
        periods = np.array([matrix.dt for matrix in matrices])
        for record in records[:count]:
            row, here = int(record["row"]), present[:, record["row"]]
            values = whole[row]
            if not here.all():
                values = np.concatenate([truth[k][row] for k in np.flatnonzero(here).tolist()])
            begin = int(starts[here].min())
            end = int(ends[here].max() + periods[here].max())
            yield _written(record, out, begin, end, sizes[here], values)

    def _page(self, number: int, matrices: Sequence[_Matrix], group: Group) -> Page:
        grids = list(dict.fromkeys(matrix.grid for matrix in matrices))
        there = group.numbers != GONE
        columns = max(matrix.patch.columns for matrix in matrices)
        strides = np.zeros((len(matrices), columns), np.uint8)
        numbers = np.empty((4, len(matrices), len(there)), np.int64)
        heads, codes, used = [], [], 0
        for k, matrix in enumerate(matrices):
            patch = matrix.patch
            own = matrix.strides
            strides[k, : patch.columns] = np.frombuffer(own, np.uint8)
            sampling = Sampling(
                matrix.rows, patch.columns, matrix.grid[2], own if any(own) else b""
            )
            found = encode_matrices(
                matrix.filled("lows", -np.inf),
                matrix.filled("highs", np.inf),
                sampling,
                self._least_widths[patch.number],
            )
            numbers[0, k], numbers[1, k] = found.exponents, found.offsets
            numbers[2, k], numbers[3, k] = found.ends[:-1] + used, found.ends[1:] + used
            codes.append(found.codes)
            used += len(found.codes)
            grid = grids.index(matrix.grid)
            heads.append(
                (patch.number, patch.columns, matrix.start, matrix.last, grid, patch.epoch)
            )
        samples = np.array([matrix.samples for matrix in matrices])
        return Page(
            number,
            np.array(heads, np.int64),
            np.array([grid[1:4] for grid in grids], np.int64),
            np.array([grid[4] for grid in grids]),
            strides,
            np.asarray(strides.any(axis=1)),
            samples,
            numbers[0],
            numbers[1],
            numbers[2],
            numbers[3],
            np.concatenate(codes),
        )

    def _write_peaks(self, found: Sequence[Any], group: Group) -> Iterator[Written]:
        if not found:
            return
        peaks = np.concatenate(found)
        subjects = np.array([self._subjects[k] for k in peaks["patch"].tolist()])
        for subject in np.unique(subjects):
            own = peaks[subjects == subject]
            own = own[np.argsort(own["row"], kind="stable")]
            out = np.empty(len(own) * (PEAK_BYTES + HEAD_BYTES), np.uint8)
            records = np.empty(len(own), RECORD)
            _, count = write_peaks(own, self._writing, group, out, records)
            for record in records[:count]:
                yield _written(record, out, 0, 0, np.empty((0, 2), np.uint32), np.empty(0))


def _written(
    record: Any,
    out: NDArray[np.uint8],
    begin: int,
    end: int,
    sizes: NDArray[np.uint32],
    values: Floats,
) -> Written:
    row, kind, sequence, earliest, latest, samples, start, stop = record.tolist()
    body, time = out[start:stop].tobytes(), (earliest, latest)
    return Written(row, kind, sequence, body, time, samples, begin, end, sizes, values)
