"""Compiled kernels that fold samples of patches into pictures of a skin."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final, NamedTuple, TypeAlias

import numpy as np

from eskin.kernels.jit import kernel, part
from eskin.kernels.outward_rounding import greater, lesser
from eskin.wire.frames.frame_scan import Part

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from eskin.interval import Floats
    from eskin.wire.frames.frame_scan import Records
    from eskin_cloud.store.patch_run import PatchRun

    Integers: TypeAlias = NDArray[np.int64]
    Bytes: TypeAlias = NDArray[np.uint8]

_MOST_COLUMNS: Final = 64
_PATCH, _EARLIEST, _LATEST, _DELAY, _PERIOD = (
    int(part) for part in (Part.PATCH, Part.EARLIEST, Part.LATEST, Part.DELAY, Part.PERIOD)
)
_FIRST_ROW, _ROWS, _COLUMNS, _STRIDES, _BEGIN = (
    int(part) for part in (Part.FIRST_ROW, Part.ROWS, Part.COLUMNS, Part.STRIDES, Part.BEGIN)
)


class PictureHulls(NamedTuple):
    """Hulls of the samples of each picture and channel; shapes ``(pictures, channels)``.

    Attributes:
        lo: Least lower bound; ``inf`` without samples.
        hi: Greatest upper bound; ``-inf`` without samples.
        peak: Greatest lower bound.
        n: Number of samples.
        gap: Whether a channel is unknown at some time of a picture.
        last: Time of each channel's last sample so far, UTC ns.
        dt: Its period, ns; 0 before the first sample.
    """

    lo: Floats
    hi: Floats
    peak: Floats
    n: NDArray[np.int32]
    gap: NDArray[np.bool_]
    last: Integers
    dt: Integers

    @classmethod
    def empty(cls, pictures: int, channels: int) -> PictureHulls:
        """Without samples."""
        shape = pictures, channels
        return cls(
            np.full(shape, np.inf),
            np.full(shape, -np.inf),
            np.full(shape, -np.inf),
            np.zeros(shape, np.int32),
            np.zeros(shape, np.bool_),
            np.zeros(channels, np.int64),
            np.zeros(channels, np.int64),
        )


class ColumnPlaces(NamedTuple):
    """Where the columns of a layout's patches are in a picture; shapes ``(patches, 64)``.

    Attributes:
        channel: Number of the picture's channel, or -1.
        skew: How much later than its row a column is sampled, ns.
    """

    channel: Integers
    skew: Integers

    @classmethod
    def empty(cls, patches: int) -> ColumnPlaces:
        """None of the columns is in the picture."""
        shape = patches, _MOST_COLUMNS
        return cls(np.full(shape, -1, np.int64), np.zeros(shape, np.int64))


def fold_records(
    records: Records, places: ColumnPlaces, grid: tuple[int, int], out: PictureHulls
) -> None:
    """Add the samples of records.

    Args:
        records: Of frames of one layout.
        places: Of that layout's columns.
        grid: Start of the first picture, and the width of all, ns.
        out: The hulls so far.
    """
    if len(records.whole):
        _fold_records(records.data, records.whole, (records.lo, records.hi), places, grid, out)


def fold_run(
    run: PatchRun, patch: int, places: ColumnPlaces, grid: tuple[int, int], out: PictureHulls
) -> None:
    """Add the samples of a run of a patch; otherwise as `fold_records`."""
    strides = np.frombuffer(run.strides, np.uint8)
    bounds = np.ascontiguousarray(run.lo).ravel(), np.ascontiguousarray(run.hi).ravel()
    when = run.t, run.dt, run.first_row % 2**16
    _fold_run(bounds, run.lo.shape, when, strides, (places.channel[patch], places.skew[patch]),
              grid, out)  # fmt: skip


@kernel
def _fold_records(
    data: Bytes,
    whole: Integers,
    bounds: tuple[Floats, Floats],
    places: ColumnPlaces,
    grid: tuple[int, int],
    out: PictureHulls,
) -> None:
    for record in range(len(whole)):
        row = whole[record]
        patch, columns = row[_PATCH], row[_COLUMNS]
        begin, size = row[_BEGIN], row[_ROWS] * columns
        strides = data[:0]
        if row[_STRIDES] >= 0:
            strides = data[row[_STRIDES] : row[_STRIDES] + columns]
        earliest, latest = row[_EARLIEST], row[_LATEST]
        t = (earliest & latest) + ((earliest ^ latest) >> 1) + row[_DELAY]
        mine = bounds[0][begin : begin + size], bounds[1][begin : begin + size]
        _fold(
            mine, (row[_ROWS], columns), (t, row[_PERIOD], row[_FIRST_ROW] % 2**16), strides,
            (places.channel[patch], places.skew[patch]), grid, out,
        )  # fmt: skip


@kernel
def _fold_run(
    bounds: tuple[Floats, Floats],
    shape: tuple[int, int],
    when: tuple[int, int, int],
    strides: Bytes,
    places: tuple[Integers, Integers],
    grid: tuple[int, int],
    out: PictureHulls,
) -> None:
    _fold(bounds, shape, when, strides, places, grid, out)


@part
def _fold(
    bounds: tuple[Floats, Floats],
    shape: tuple[int, int],
    when: tuple[int, int, int],
    strides: Bytes,
    places: tuple[Integers, Integers],
    grid: tuple[int, int],
    out: PictureHulls,
) -> None:
    """Add a matrix of samples: ``when`` is the first row's time, the period, and its number."""
    channels, skews = places
    _follow(shape, when, strides, places, grid, (out.last, out.dt, out.gap))
    # An array that is taken out of a tuple in a loop costs more there than a sample.
    low, high = bounds
    least, most, peak, number = out.lo, out.hi, out.peak, out.n
    for row in range(shape[0]):
        behind = when[0] + row * when[1] - grid[0]
        picture, begin = np.int64(-1), np.int64(0)
        for column in range(shape[1]):
            channel = channels[column]
            if channel < 0:
                continue
            if strides.size and (when[2] + row) & ((1 << np.int64(strides[column])) - 1):
                continue
            late = behind + skews[column]
            if picture < 0 or late < begin or late >= begin + grid[1]:  # division is slow
                picture = late // grid[1] if late >= 0 else np.int64(-1)
                begin = picture * grid[1]
            if 0 <= picture < len(least):
                cell = row * shape[1] + column
                least[picture, channel] = lesser(low[cell], least[picture, channel])
                most[picture, channel] = greater(high[cell], most[picture, channel])
                peak[picture, channel] = greater(low[cell], peak[picture, channel])
                number[picture, channel] += 1


@part
def _follow(
    shape: tuple[int, int],
    when: tuple[int, int, int],
    strides: Bytes,
    places: tuple[Integers, Integers],
    grid: tuple[int, int],
    known: tuple[Integers, Integers, NDArray[np.bool_]],
) -> None:
    """Mark gaps before the samples of a matrix, and remember the last of each column."""
    channels, skews = places
    latest, periods, gap = known
    for column in range(shape[1]):
        channel = channels[column]
        if channel < 0:
            continue
        first, final, dt = np.int64(0), shape[0] - 1, when[1]
        if strides.size and strides[column]:
            step: Any = 1 << np.int64(strides[column])
            first = -when[2] % step
            if first >= shape[0]:
                continue
            final, dt = first + (final - first) // step * step, dt * step
        begin = when[0] + skews[column] + first * when[1]
        end = when[0] + skews[column] + final * when[1]
        before = periods[channel]
        if not before:
            _mark(grid[0], begin, channel, grid, gap)
        elif begin - latest[channel] > before + before // 2:
            _mark(latest[channel] + before, begin, channel, grid, gap)
        if not before or end >= latest[channel]:
            latest[channel], periods[channel] = end, dt


@part
def _mark(
    start: int, end: int, channel: int, grid: tuple[int, int], gap: NDArray[np.bool_]
) -> None:
    """Mark the pictures that overlap a range of time."""
    first = max((start - grid[0]) // grid[1], 0)
    for picture in range(first, min((end - 1 - grid[0]) // grid[1] + 1, len(gap))):
        gap[picture, channel] = True


@kernel
def close_gaps(grid: tuple[int, int], out: PictureHulls) -> None:
    """Mark what lies after the last sample of each channel, once all are added."""
    latest, periods, gap = out.last, out.dt, out.gap
    end = grid[0] + grid[1] * len(gap)
    for channel in range(latest.size):
        before = periods[channel]
        if not before:
            _mark(grid[0], end, channel, grid, gap)
        elif end - latest[channel] > before + before // 2:
            _mark(latest[channel] + before, end, channel, grid, gap)
