"""Collects what taxels measured in one stretch of time, and writes it as frames."""

from array import array

from eskin_sensor_node.firmware.rounding import INFINITY
from eskin_sensor_node.firmware.sample_codec import Sampling, encode_samples

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from typing import Any

    from eskin_sensor_node.firmware.clock import Clock
    from eskin_sensor_node.firmware.message_writer import MessageWriter, Record, Time
    from eskin_sensor_node.firmware.peaks import PeakEvent
    from eskin_sensor_node.firmware.schedule import Frame

    Encode = Callable[
        [Sequence[float], Sequence[float], int, int, int, Sequence[int], int],
        tuple[int, int, bytes],
    ]
    """Lower and upper bounds row after row, rows, columns, number of the first row, strides,
    finest exponent; gives exponent, offset, codes."""

MOST_GRIDS = 16
"""In one frame: a page has no more patches."""
MOST_PEAKS = 250
"""In one message: it fits 64 KiB."""
MOST_VERDICTS = 250
"""Of all monitors in a stretch: they fit one message."""


def encode(
    lows: "Sequence[float]",
    highs: "Sequence[float]",
    rows: int,
    columns: int,
    first_row: int,
    strides: "Sequence[int]",
    finest: int,
) -> "tuple[int, int, bytes]":
    """Encode a matrix of samples."""
    return encode_samples(lows, highs, Sampling(rows, columns, first_row, strides), finest)


class Patch:
    """What the firmware must know of a patch.

    Attributes:
        number: In the layout.
        page: Whose frames hold it.
        columns: Channels.
        finest: Finest exponent of its quanta.
        subject: Name of the person that its samples are about; empty where they are of none.
        epoch: Of errors that its samples share; 0 where they share none.
    """

    __slots__ = ("columns", "epoch", "finest", "number", "page", "subject")

    def __init__(
        self, number: int, page: int, columns: int, finest: int, subject: str, epoch: int
    ) -> None:
        self.number = number
        self.page = page
        self.columns = columns
        self.finest = finest
        self.subject = subject
        self.epoch = epoch


class _Part:
    """What one column of a patch has of a stretch: samples, or none that are sent."""

    __slots__ = ("column", "coverage", "dt", "highs", "lows", "n", "start")

    def __init__(
        self,
        column: int,
        frame: "Frame",
        coverage: float,
        lows: "array[float] | None",
        highs: "array[float] | None",
    ) -> None:
        self.column = column
        self.start = frame.start
        self.dt = frame.dt
        self.n = frame.n
        self.coverage = coverage
        self.lows = lows
        self.highs = highs


class Matrix:
    """Samples of one patch in one stretch: rows × columns.

    Its rows are those of all columns that were sampled, whether their samples are sent or not.

    Attributes:
        patch: The patch.
        start: Ticks of the first row.
        dt: From row to row, ns.
        rows: How many.
        strides: Of each column ``k``: it is sampled in rows whose number is a multiple of ``2^k``.
        samples: How many samples are sent.
        coverage: Least probability that a sample's interval encloses the truth.
    """

    __slots__ = ("_parts", "coverage", "dt", "patch", "rows", "samples", "start", "strides")

    def __init__(self, patch: Patch, parts: "Sequence[_Part]") -> None:
        self.patch = patch
        self._parts = parts
        self.start = min(part.start for part in parts)
        self.dt = min(part.dt for part in parts)
        last = max(part.start + (part.n - 1) * part.dt for part in parts)
        self.rows = (last - self.start) // self.dt + 1
        self.samples = sum(part.n for part in parts if part.lows is not None)
        self.coverage = min(part.coverage for part in parts)
        self.strides = bytearray(patch.columns)
        for part in parts:
            while self.dt << self.strides[part.column] < part.dt:
                self.strides[part.column] += 1

    @property
    def last(self) -> int:
        """Ticks of the last row."""
        return self.start + (self.rows - 1) * self.dt

    @property
    def first_row(self) -> int:
        """Number of the first row; rows at whole multiples of the period have their quotient."""
        return self.start // self.dt

    def bounds(self) -> "tuple[array[float], array[float]]":
        """Lower and upper bounds, row after row; what is not sent is unknown."""
        size = self.rows * self.patch.columns
        lows = array("d", [-INFINITY] * size)
        highs = array("d", [INFINITY] * size)
        for part in self._parts:
            if part.lows is None or part.highs is None:
                continue
            cell = (part.start - self.start) // self.dt * self.patch.columns + part.column
            step = part.dt // self.dt * self.patch.columns
            for k in range(part.n):
                lows[cell] = part.lows[k]
                highs[cell] = part.highs[k]
                cell += step
        return lows, highs

    def release(self) -> None:
        """Free the samples, which are written."""
        self._parts = ()


class Assembler:
    """Collects samples, peaks and verdicts until `flush` writes them.

    The columns of a patch whose taxels are sampled at the same instants become one matrix. A node
    sets their rates so that one is another divided by a power of two.

    Args:
        clock: What the node knows of time.
        message_writer: Writes its messages.
        encode: Encodes matrices.

    Attributes:
        written: Of each frame that the latest `flush` wrote, its matrices without their samples.
    """

    def __init__(
        self, clock: "Clock", message_writer: "MessageWriter", encode: "Encode" = encode
    ) -> None:
        self._clock = clock
        self._message_writer = message_writer
        self._encode = encode
        self._patches: dict[int, Patch] = {}
        self._parts: dict[int, list[_Part]] = {}
        self._peaks: list[tuple[str, Time, Sequence[Any]]] = []
        self._verdicts: list[tuple[Time, Sequence[Any]]] = []
        self.written: list[list[Matrix]] = []

    @property
    def begin(self) -> "int | None":
        """Ticks of the first sample that waits."""
        starts = [part.start for parts in self._parts.values() for part in parts]
        return min(starts) if starts else None

    @property
    def samples(self) -> int:
        """How many samples wait."""
        return sum(part.n for parts in self._parts.values() for part in parts)

    def add(
        self,
        patch: Patch,
        column: int,
        frame: "Frame",
        coverage: float,
        bounds: "tuple[array[float], array[float]] | None",
    ) -> None:
        """Take what a column was sampled at, and its bounds where they are sent; copies them."""
        lows = highs = None
        if bounds is not None:
            lows, highs = bounds[0][: frame.n], bounds[1][: frame.n]
        self._patches[patch.number] = patch
        part = _Part(column, frame, coverage, lows, highs)
        self._parts.setdefault(patch.number, []).append(part)

    def state_peak(
        self, patch: Patch, column: int, event: "PeakEvent", time: "Time", coverage: float
    ) -> None:
        """Take a peak, or a region of possible ones."""
        stated = (
            patch.number,
            column,
            time,
            event.verdict,
            event.count,
            event.height,
            event.prominence,
            coverage,
        )
        self._peaks.append((patch.subject, time, stated))

    def state_verdict(
        self, monitor: str, time: "Time", verdict: int, because: int, coverage: float
    ) -> None:
        """Take a monitor's verdict at an instant; of too many in a stretch the last ones stay."""
        if len(self._verdicts) == MOST_VERDICTS:
            del self._verdicts[MOST_VERDICTS // 2]
        self._verdicts.append((time, (monitor, time, verdict, True, because, coverage)))

    def flush(self) -> "list[Record]":
        """Write what was taken: a frame a page, peaks of each subject, verdicts."""
        pages: dict[int, list[Matrix]] = {}
        for number in sorted(self._parts):
            matrix = Matrix(self._patches[number], self._parts[number])
            if matrix.samples:
                pages.setdefault(matrix.patch.page, []).append(matrix)
        self._parts = {}
        self.written = []
        records = []
        for page in sorted(pages):
            records.append(self._write_frame(page, pages[page]))
            self.written.append(pages[page])
        records += self._write_peaks()
        if self._verdicts:
            records.append(self._write_verdicts())
        return records

    def _write_frame(self, page: int, matrices: "list[Matrix]") -> "Record":
        first = min(matrix.start for matrix in matrices)
        lasting = max(matrix.last for matrix in matrices) - first
        grids: list[tuple[int, int, int, int, float]] = []
        patches = []
        for matrix in matrices:
            delay = matrix.start - first
            grid = delay, matrix.dt, matrix.first_row, matrix.rows, matrix.coverage
            if grid not in grids:
                grids.append(grid)
            patches.append(self._encoded(matrix, grids.index(grid)))
            matrix.release()
        time = self._clock.enclosure(first, lasting)
        samples = sum(matrix.samples for matrix in matrices)
        return self._message_writer.frame(
            page, first, time, grids, patches, samples=samples, lasting=lasting
        )

    def _encoded(self, matrix: Matrix, grid: int) -> "Sequence[Any]":
        patch = matrix.patch
        strides = bytes(matrix.strides) if max(matrix.strides) > 0 else b""
        lows, highs = matrix.bounds()
        exponent, offset, codes = self._encode(
            lows, highs, matrix.rows, patch.columns, matrix.first_row, strides, patch.finest
        )
        head = [patch.number, grid, patch.epoch, patch.columns, exponent, offset, codes]
        return head + ([{1: strides}] if strides else [])

    def _write_verdicts(self) -> "Record":
        found, self._verdicts = self._verdicts, []
        time = found[0][0][0], found[-1][0][1]
        return self._message_writer.statements(time, verdicts=[stated for _, stated in found])

    def _write_peaks(self) -> "list[Record]":
        by_subject: dict[str, list[tuple[Time, Sequence[Any]]]] = {}
        for subject, time, stated in self._peaks:
            by_subject.setdefault(subject, []).append((time, stated))
        self._peaks = []
        records = []
        for subject in sorted(by_subject):
            found = by_subject[subject]
            for k in range(0, len(found), MOST_PEAKS):
                some = found[k : k + MOST_PEAKS]
                time = min(span[0] for span, _ in some), max(span[1] for span, _ in some)
                stated = [peak for _, peak in some]
                records.append(self._message_writer.statements(time, peaks=stated))
        return records
