"""Compiled kernels that fold samples of patches into pictures of a skin."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final, NamedTuple, TypeAlias

import numpy as np

from eskin.kernels.jit import kernel, part
from eskin.kernels.outward_rounding import greater, lesser
from eskin.wire.frames.frame_scan import Part
from eskin_cloud.rollup.column_aggregates import BREAKS, COUNT, ERROR, FIRST, LAST, PERIOD

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from eskin.interval import Floats
    from eskin.wire.frames.frame_scan import Records
    from eskin_cloud.rollup.column_aggregates import PackedAggregates
    from eskin_cloud.store.patch_run import PatchMatrix

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
        error: By how much its time is uncertain, ns; 0 where pictures are of the node's own clock.
    """

    lo: Floats
    hi: Floats
    peak: Floats
    n: NDArray[np.int32]
    gap: NDArray[np.bool_]
    last: Integers
    dt: Integers
    error: Integers

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
            *np.zeros((3, channels), np.int64),
        )

    @classmethod
    def joined(cls, parts: Sequence[PictureHulls]) -> PictureHulls:
        """Pictures of several groups of channels, one group after the other."""
        return cls(*(np.concatenate(each, axis=-1) for each in zip(*parts, strict=True)))


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
    records: Records,
    places: ColumnPlaces,
    grid: tuple[int, int],
    out: PictureHulls,
    *,
    spread: bool = False,
) -> None:
    """Add the samples of records.

    Args:
        records: Of frames of one layout.
        places: Of that layout's columns.
        grid: Start of the first picture, and the width of all, ns.
        out: The hulls so far.
        spread: Whether a sample belongs to each picture that its true time may lie in; else to the
            one of the middle of its time.
    """
    if len(records.whole):
        bounds = records.lo, records.hi
        _fold_records(records.data, records.whole, bounds, places, grid, out, spread)


def fold_matrix(
    runs: PatchMatrix,
    places: ColumnPlaces,
    grid: tuple[int, int],
    out: PictureHulls,
    *,
    spread: bool = False,
) -> None:
    """Add the samples of runs of one description, in order of time.

    Args:
        runs: The runs.
        places: Of its columns: the first row of the arrays.
        grid: As in `fold_records`.
        out: As in `fold_records`.
        spread: As in `fold_records`.
    """
    columns = runs.lo.shape[1]
    whole = np.zeros((len(runs.t), len(Part)), np.int64)
    whole[:, _EARLIEST], whole[:, _LATEST] = runs.t - runs.error, runs.t + runs.error
    whole[:, _PERIOD], whole[:, _FIRST_ROW] = runs.dt, runs.first_row
    whole[:, _ROWS], whole[:, _COLUMNS] = runs.rows, columns
    whole[:, _BEGIN] = (np.cumsum(runs.rows) - runs.rows) * columns
    sizes = np.array([len(strides) for strides in runs.strides])
    begins = np.where(sizes > 0, np.cumsum(sizes) - sizes, -1)
    whole[:, _STRIDES] = begins[runs.option]
    data = np.frombuffer(b"".join(runs.strides), np.uint8)
    bounds = runs.lo.ravel(), runs.hi.ravel()
    _fold_records(data, whole, bounds, places, grid, out, spread)


def fold_tiles(
    chunk: PackedAggregates,
    channels: Integers,
    within: tuple[int, int],
    grid: tuple[int, int],
    out: PictureHulls,
    *,
    spread: bool = False,
) -> None:
    """Add the tiles of a chunk, each of which lies within a picture.

    Args:
        chunk: Tiles of all columns of a patch.
        channels: The picture's channel of each column, or -1.
        within: Tiles that begin from a time on, and before another, are added; UTC ns.
        grid: As in `fold_records`.
        out: As in `fold_records`; ``peak`` gets the least lower bound of a tile.
        spread: As in `fold_records`, for all samples of a tile.
    """
    column, whole, lo, hi = chunk.hulls_and_times()
    _fold_tiles(channels[column], whole, (lo, hi), within, grid, out, spread)


@kernel
def _fold_records(
    data: Bytes,
    whole: Integers,
    bounds: tuple[Floats, Floats],
    places: ColumnPlaces,
    grid: tuple[int, int],
    out: PictureHulls,
    spread: bool,  # noqa: FBT001 - a kernel's
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
        error: Any = (latest - earliest + 1) // 2 if spread else 0
        mine = bounds[0][begin : begin + size], bounds[1][begin : begin + size]
        _fold(
            mine, (row[_ROWS], columns), (t, row[_PERIOD], row[_FIRST_ROW] % 2**16, error), strides,
            (places.channel[patch], places.skew[patch]), grid, out,
        )  # fmt: skip


@kernel
def _fold_tiles(
    channels: Integers,
    whole: Integers,
    bounds: tuple[Floats, Floats],
    within: tuple[int, int],
    grid: tuple[int, int],
    out: PictureHulls,
    spread: bool,  # noqa: FBT001 - a kernel's
) -> None:
    low, high = bounds
    least, most, peak, number = out.lo, out.hi, out.peak, out.n
    latest, periods, gap, errors = out.last, out.dt, out.gap, out.error
    for k in range(channels.size):
        channel, first, last = channels[k], whole[FIRST, k], whole[LAST, k]
        error = whole[ERROR, k] if spread else np.int64(0)
        begin = (first - error - grid[0]) // grid[1]
        end = begin if not spread else (last + error - grid[0]) // grid[1]
        outside = first < within[0] or first >= within[1]
        if channel < 0 or outside or end < 0 or begin >= len(least):
            continue
        before = periods[channel]
        if not before:
            _mark(grid[0], first + error, channel, grid, gap)
        elif first - latest[channel] > before + before // 2:
            until = latest[channel] + before - errors[channel]
            _mark(until, first + error, channel, grid, gap)
        if not before or last >= latest[channel]:
            latest[channel], periods[channel], errors[channel] = last, whole[PERIOD, k], error
        for picture in range(max(begin, 0), min(end + 1, len(least))):
            if whole[BREAKS, k]:
                gap[picture, channel] = True
            least[picture, channel] = lesser(low[k], least[picture, channel])
            most[picture, channel] = greater(high[k], most[picture, channel])
            number[picture, channel] += whole[COUNT, k]
        if begin == end:
            peak[begin, channel] = greater(low[k], peak[begin, channel])


@part
def _fold(
    bounds: tuple[Floats, Floats],
    shape: tuple[int, int],
    when: tuple[int, int, int, int],
    strides: Bytes,
    places: tuple[Integers, Integers],
    grid: tuple[int, int],
    out: PictureHulls,
) -> None:
    """Add a matrix of samples: ``when`` is the first row's time, the period, its number, error."""
    channels, skews = places
    _follow(shape, when, strides, places, grid, (out.last, out.dt, out.error, out.gap))
    if when[3]:
        _spread(bounds, shape, when, strides, places, grid, out)
        return
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
def _spread(
    bounds: tuple[Floats, Floats],
    shape: tuple[int, int],
    when: tuple[int, int, int, int],
    strides: Bytes,
    places: tuple[Integers, Integers],
    grid: tuple[int, int],
    out: PictureHulls,
) -> None:
    """Add each sample of a matrix to all pictures that its true time may lie in."""
    channels, skews = places
    low, high = bounds
    least, most, peak, number = out.lo, out.hi, out.peak, out.n
    for row in range(shape[0]):
        behind = when[0] + row * when[1] - grid[0]
        for column in range(shape[1]):
            channel = channels[column]
            if channel < 0:
                continue
            if strides.size and (when[2] + row) & ((1 << np.int64(strides[column])) - 1):
                continue
            late = behind + skews[column]
            cell = row * shape[1] + column
            begin, end = (late - when[3]) // grid[1], (late + when[3]) // grid[1]
            for picture in range(max(begin, 0), min(end + 1, len(least))):
                least[picture, channel] = lesser(low[cell], least[picture, channel])
                most[picture, channel] = greater(high[cell], most[picture, channel])
                number[picture, channel] += 1
            if begin == end and 0 <= begin < len(least):
                peak[begin, channel] = greater(low[cell], peak[begin, channel])


@part
def _follow(
    shape: tuple[int, int],
    when: tuple[int, int, int, int],
    strides: Bytes,
    places: tuple[Integers, Integers],
    grid: tuple[int, int],
    known: tuple[Integers, Integers, Integers, NDArray[np.bool_]],
) -> None:
    """Mark gaps before the samples of a matrix, and remember the last of each column."""
    channels, skews = places
    latest, periods, errors, gap = known
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
            _mark(grid[0], begin + when[3], channel, grid, gap)
        elif begin - latest[channel] > before + before // 2:
            until = latest[channel] + before - errors[channel]
            _mark(until, begin + when[3], channel, grid, gap)
        if not before or end >= latest[channel]:
            latest[channel], periods[channel], errors[channel] = end, dt, when[3]


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
    """Mark what lies after the last sample of each channel, once all are added.

    Nothing follows it, so that it holds for one period, and its time may be the earliest one. A
    sample that follows at or after the pictures' end must be among those that were added.
    """
    latest, periods, errors, gap = out.last, out.dt, out.error, out.gap
    end = grid[0] + grid[1] * len(gap)
    for channel in range(latest.size):
        before, last = periods[channel], latest[channel] - errors[channel]
        if not before:
            _mark(grid[0], end, channel, grid, gap)
        elif end > last + before:
            _mark(last + before, end, channel, grid, gap)
