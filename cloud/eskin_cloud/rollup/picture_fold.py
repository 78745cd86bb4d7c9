"""Compiled kernels that fold samples of patches into pictures of a skin."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple, TypeAlias

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
    """

    lo: Floats
    hi: Floats
    peak: Floats
    n: NDArray[np.int32]

    @classmethod
    def empty(cls, pictures: int, channels: int) -> PictureHulls:
        """Without samples."""
        shape = pictures, channels
        return cls(
            np.full(shape, np.inf),
            np.full(shape, -np.inf),
            np.full(shape, -np.inf),
            np.zeros(shape, np.int32),
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
    for column in range(shape[1]):
        channel = places[0][column]
        if channel < 0:
            continue
        step = 1 << np.int64(strides[column]) if strides.size else 1
        for row in range(-when[2] % step, shape[0], step):
            behind = when[0] + row * when[1] + places[1][column] - grid[0]
            picture = behind // grid[1]
            if behind < 0 or picture >= len(out.lo):
                continue
            cell = row * shape[1] + column
            out.lo[picture, channel] = lesser(bounds[0][cell], out.lo[picture, channel])
            out.hi[picture, channel] = greater(bounds[1][cell], out.hi[picture, channel])
            out.peak[picture, channel] = greater(bounds[0][cell], out.peak[picture, channel])
            out.n[picture, channel] += 1
