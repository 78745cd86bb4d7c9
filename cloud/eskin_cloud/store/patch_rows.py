"""Samples of one patch from many frames, as the bytes of one row.

Values, not bytes, equal those of the frames: bounds bit for bit, times, ticks, epochs, coverage and
positions. Bounds are in the codes of a frame, a column after the other, so that one column is read
without the others (`eskin.wire.frames.column_codec`). What describes the runs is differenced from
run to run. All of it is CBOR, compressed with zstd.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final, NamedTuple

import cbor2
import numpy as np
import pyarrow as pa

from eskin.errors import MessageError
from eskin.wire.frames.column_codec import ColumnCodes, decode_columns, encode_columns_exactly
from eskin.wire.frames.sample_codec import MOST_COLUMNS, MOST_STRIDE
from eskin.wire.messages.cbor_map import Fields, integer, items, load_any, octets, row
from eskin_cloud.store.column_runs import ColumnRuns
from eskin_cloud.store.patch_run import PatchMatrix, PatchRun

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.typing import NDArray

    from eskin.interval import Floats

_LEVEL: Final = 1
_SIZE_BYTES: Final = 4
MOST_BYTES: Final = 2**24
"""Of a row before it is compressed."""
MOST_CELLS: Final = 2**22
"""Instants times columns of a row."""
MOST_RUNS: Final = 2**16
_HASH, _COLUMNS, _HEADS, _OPTIONS, _SEGMENTS = range(1, 6)


class _Heads(NamedTuple):
    """What describes the runs, an array each; ``drift`` is ``t - ticks``."""

    boot: NDArray[np.int64]
    sequence: NDArray[np.int64]
    ticks: NDArray[np.int64]
    drift: NDArray[np.int64]
    error: NDArray[np.int64]
    dt: NDArray[np.int64]
    first_row: NDArray[np.int64]
    rows: NDArray[np.int64]
    epoch: NDArray[np.int64]
    coverage: NDArray[np.int64]
    option: NDArray[np.int64]


_Option = tuple[bytes, tuple[int, ...]]
"""Strides and unshared columns."""


def encode_runs(runs: Sequence[PatchRun]) -> bytes:
    """Encode runs of one patch, at least one, in any order.

    Args:
        runs: All with the same description and number of columns.

    Raises:
        MessageError: They differ in their description, a sample is an empty interval, or the
            bounds of a run are not those of any frame.
    """
    columns = runs[0].lo.shape[1]
    if len(runs) > MOST_RUNS or sum(run.lo.size for run in runs) > MOST_CELLS:
        raise MessageError(f"{len(runs)} runs are too many for one row; divide them")
    if any(run.patch != runs[0].patch or run.lo.shape[1] != columns for run in runs):
        raise MessageError("runs are of several descriptions; a row holds those of one")
    options = list(dict.fromkeys((run.strides, run.unshared) for run in runs))
    heads = np.array([_head(run, options) for run in runs], np.int64).T
    body = cbor2.dumps({
        _HASH: runs[0].patch,
        _COLUMNS: columns,
        _HEADS: _planes(np.diff(heads, axis=1, prepend=0)),
        _OPTIONS: [[strides, list(unshared)] for strides, unshared in options],
        _SEGMENTS: _segments(runs),
    })  # fmt: skip
    if len(body) > MOST_BYTES:
        raise MessageError(f"runs take {len(body)} bytes; at most {MOST_BYTES} are allowed")
    return compress(body)


def decode_runs(data: bytes) -> list[PatchRun]:
    """Decode runs, as they were encoded.

    Raises:
        MessageError: The bytes are not those of any runs.
    """
    return _decode(data, bounds=True)


def decode_heads(data: bytes) -> list[PatchRun]:
    """Decode runs without their bounds, which have no columns; strides are those of all columns.

    Raises:
        MessageError: As from `decode_runs`.
    """
    return _decode(data, bounds=False)


def decode_matrix(data: bytes) -> PatchMatrix:
    """Decode runs into arrays, for those that read all of a row's samples.

    Raises:
        MessageError: As from `decode_runs`.
    """
    description, options, heads, steps, segments = _open(data)
    lo, hi = _decode_segments(segments, heads, steps)
    return PatchMatrix(
        patch=description,
        t=heads.ticks + heads.drift,
        error=heads.error,
        dt=heads.dt,
        first_row=heads.first_row,
        rows=heads.rows,
        option=heads.option,
        strides=tuple(strides for strides, _ in options),
        lo=lo,
        hi=hi,
    )


def decode_column(data: bytes, column: int) -> ColumnRuns:
    """Decode the runs of one column that have samples of it; times are those of their rows.

    Raises:
        MessageError: As from `decode_runs`, or the column is not there.
    """
    _, _, heads, steps, segments = _open(data)
    if not 0 <= column < steps.shape[1]:
        raise MessageError(f"column {column} is read of a row that has {steps.shape[1]}")
    lo, hi = _decode_column(segments, heads, steps, column)
    step = steps[heads.option, column]
    first = -heads.first_row % step
    n = _count(heads.rows, first, step)
    seen = n > 0
    return ColumnRuns(
        t=(heads.ticks + heads.drift + first * heads.dt)[seen],
        boot=heads.boot[seen],
        sequence=heads.sequence[seen],
        dt=(heads.dt * step)[seen],
        error=heads.error[seen],
        coverage=heads.coverage.view(np.float64)[seen],
        n=n[seen],
        lo=lo,
        hi=hi,
    )


def _steps(options: list[_Option], width: int) -> NDArray[np.int64]:
    """Each how many rows a column has a sample, by option; shape ``(options, columns)``."""
    strides = [list(stated or bytes(width)) for stated, _ in options]
    return 1 << np.array(strides, np.int64).reshape(-1, width)


def _decode_column(
    segments: list[object], heads: _Heads, steps: NDArray[np.int64], column: int
) -> tuple[Floats, Floats]:
    """The bounds of a column's samples, run after run; ``steps`` is that of `_steps`."""
    found: list[tuple[Floats, Floats]] = []
    strided = bool(np.any(steps > 1))
    for mine, encoded in _read_segments(segments, heads, steps.shape[1]):
        rows = heads.rows[mine]
        counts = np.full(steps.shape[1], rows.sum())
        if strided:
            of_run = steps[heads.option[mine]]
            first = -heads.first_row[mine, np.newaxis] % of_run
            counts = _count(rows[:, np.newaxis], first, of_run).sum(axis=0)
        found.append(decode_columns(encoded, counts, [column]))
    lo, hi = (np.concatenate(side) for side in zip(*found, strict=True))
    return lo, hi


def _count(
    rows: NDArray[np.int64], first: NDArray[np.int64], step: NDArray[np.int64]
) -> NDArray[np.int64]:
    """How many rows have a sample, if the first one and each so many after it has."""
    counted: NDArray[np.int64] = np.maximum(0, -((first - rows) // step))
    return counted


class _Opened(NamedTuple):
    """A row whose bounds are not decoded yet; ``steps`` is that of `_steps`."""

    description: bytes
    options: list[_Option]
    heads: _Heads
    steps: NDArray[np.int64]
    segments: list[object]


def _open(data: bytes) -> _Opened:
    fields = Fields(_map(load_any(decompress(data, MOST_BYTES), "row")))
    width = fields.integer(_COLUMNS, 1, MOST_COLUMNS)
    options = [_option(each, width) for each in fields.items(_OPTIONS, MOST_RUNS)]
    return _Opened(
        fields.octets(_HASH, 1, 64),
        options,
        _heads(fields.octets(_HEADS, 1, MOST_BYTES), len(options)),
        _steps(options, width),
        fields.items(_SEGMENTS, MOST_RUNS),
    )


def _decode(data: bytes, *, bounds: bool) -> list[PatchRun]:
    description, options, heads, steps, segments = _open(data)
    nothing = np.empty((0, 0))
    lo, hi = _decode_segments(segments, heads, steps) if bounds else (nothing, nothing)
    ends = np.cumsum(heads.rows)
    places = zip((ends - heads.rows).tolist(), ends.tolist(), strict=True)
    numbers = zip(*(column.tolist() for column in heads), strict=True)
    coverages = heads.coverage.view(np.float64).tolist()
    return [
        PatchRun(
            description, boot, sequence, ticks, ticks + drift, error, dt, first_row,
            options[option][0], epoch, options[option][1], coverage, lo[begin:end], hi[begin:end],
        )
        for (boot, sequence, ticks, drift, error, dt, first_row, _, epoch, _, option),
        coverage, (begin, end) in zip(numbers, coverages, places, strict=True)
    ]  # fmt: skip


def compress(body: bytes) -> bytes:
    """Compress with zstd; the length of the body comes first."""
    packed: bytes = pa.Codec("zstd", compression_level=_LEVEL).compress(body, asbytes=True)
    return len(body).to_bytes(_SIZE_BYTES, "little") + packed


def decompress(data: bytes, most: int) -> bytes:
    """Decompress what `compress` gave.

    Raises:
        MessageError: It is something else, or longer than ``most``.
    """
    size = int.from_bytes(data[:_SIZE_BYTES], "little")
    if len(data) <= _SIZE_BYTES or size > most:
        raise MessageError(f"row of {len(data)} bytes states {size} of content; at most {most}")
    try:
        body: bytes = pa.decompress(memoryview(data)[_SIZE_BYTES:], size, "zstd", asbytes=True)
    except (pa.ArrowException, OSError) as error:
        raise MessageError(f"row cannot be decompressed: {error}") from error
    return body


def _head(run: PatchRun, options: list[_Option]) -> tuple[int, ...]:
    coverage = int(np.float64(run.coverage).view(np.int64))
    option = options.index((run.strides, run.unshared))
    place = run.boot, run.sequence, run.ticks, run.t - run.ticks, run.error
    return *place, run.dt, run.first_row, run.lo.shape[0], run.epoch, coverage, option


def _planes(numbers: NDArray[np.int64]) -> bytes:
    """The bytes of numbers, those of one weight together: most are zero."""
    return np.ascontiguousarray(numbers).view(np.uint8).reshape(-1, 8).T.tobytes()


def _heads(data: bytes, options: int) -> _Heads:
    count, rest = divmod(len(data), 8 * len(_Heads._fields))
    if rest or not 0 < count <= MOST_RUNS:
        raise MessageError(f"heads of runs have {len(data)} bytes")
    numbers = np.frombuffer(data, np.uint8).reshape(8, -1).T.copy().view(np.int64)
    heads = _Heads(*np.cumsum(numbers.reshape(-1, count), axis=1))
    coverage = heads.coverage.view(np.float64)
    if not (
        np.all((heads.rows >= 1) & (heads.rows <= MOST_CELLS))
        and np.all(heads.dt >= 1)
        and np.all((coverage >= 0) & (coverage <= 1))
        and np.all((heads.option >= 0) & (heads.option < options))
    ):
        raise MessageError("heads of runs have a value out of range")
    return heads


def _map(value: object) -> dict[int, Any]:
    if not isinstance(value, dict):
        raise MessageError("row is no CBOR map")
    return value


def _option(value: object, columns: int) -> _Option:
    strides, unshared = row(value, "options of a run", 2)
    found = octets(strides, "strides", 0, columns)
    if found and (len(found) != columns or max(found) > MOST_STRIDE):
        raise MessageError(f"strides are {found.hex()} for {columns} columns")
    listed = items(unshared, "unshared columns", columns)
    return found, tuple(integer(each, "unshared column", 0, columns - 1) for each in listed)


def _segments(runs: Sequence[PatchRun]) -> list[list[object]]:
    """Encode the bounds of runs: together, or in halves where codes would be too long."""
    rows, columns = sum(run.lo.shape[0] for run in runs), runs[0].lo.shape[1]
    lo, hi = (
        np.ascontiguousarray(np.concatenate([getattr(run, side) for run in runs]).T)
        for side in ("lo", "hi")
    )
    mask = _mask(
        np.array([run.lo.shape[0] for run in runs]),
        np.array([run.first_row for run in runs]),
        _steps([(run.strides, run.unshared) for run in runs], columns),
    )
    if mask is None:
        counts, flat = np.full(columns, rows), (lo.ravel(), hi.ravel())
    else:
        counts, flat = mask.sum(axis=1), (lo[mask], hi[mask])
    encoded = encode_columns_exactly(*flat, counts)
    if encoded is not None:
        arrays = (each.tobytes() for each in encoded[:3])
        return [[len(runs), *arrays, encoded.codes]]
    if len(runs) == 1:
        raise MessageError(
            f"bounds of boot {runs[0].boot} sequence {runs[0].sequence} are not those of a frame"
        )
    half = len(runs) // 2
    return _segments(runs[:half]) + _segments(runs[half:])


def _decode_segments(
    segments: list[object], heads: _Heads, steps: NDArray[np.int64]
) -> tuple[Floats, Floats]:
    """The bounds of all runs, a row after the other; ``steps`` is that of `_steps`."""
    found: list[tuple[Floats, Floats]] = []
    columns = steps.shape[1]
    for mine, encoded in _read_segments(segments, heads, columns):
        rows = int(heads.rows[mine].sum())
        mask = _mask(heads.rows[mine], heads.first_row[mine], steps[heads.option[mine]])
        if mask is None:
            lo, hi = decode_columns(encoded, np.full(columns, rows))
            found.append((lo.reshape(columns, rows).T, hi.reshape(columns, rows).T))
            continue
        lo, hi = np.full(mask.shape, -np.inf), np.full(mask.shape, np.inf)
        lo[mask], hi[mask] = decode_columns(encoded, mask.sum(axis=1))
        found.append((lo.T, hi.T))
    if len(found) == 1:
        return found[0]
    lo, hi = (np.concatenate(side) for side in zip(*found, strict=True))
    return lo, hi


def _read_segments(
    segments: list[object], heads: _Heads, columns: int
) -> Iterator[tuple[slice, ColumnCodes]]:
    """Which runs each segment has, and their codes."""
    begin = 0
    for segment in segments:
        runs, *arrays, codes = row(segment, "segment of a row", 5)
        end = begin + integer(runs, "runs of a segment", 1, MOST_RUNS)
        if end > len(heads.rows):
            raise MessageError("row has bounds of more runs than it has heads")
        rows = int(heads.rows[begin:end].sum())
        if rows * columns > MOST_CELLS:
            raise MessageError(f"row has {rows} instants; with its columns these are too many")
        exponents, offsets, sizes = (_integers(each, "segment of a row") for each in arrays)
        encoded = ColumnCodes(exponents, offsets, sizes, octets(codes, "codes", 0, MOST_BYTES))
        yield slice(begin, end), encoded
        begin = end
    if begin != len(heads.rows):
        raise MessageError(f"row has bounds of {begin} runs, not of {len(heads.rows)}")


def _mask(
    rows: NDArray[np.int64], first_row: NDArray[np.int64], steps: NDArray[np.int64]
) -> NDArray[np.bool_] | None:
    """Which cells hold a sample, shape ``(columns, rows)``; ``None`` for all.

    Args:
        rows: Of each run.
        first_row: Of each run.
        steps: Of each run and column: each how many rows there is a sample.
    """
    if not np.any(steps > 1):
        return None
    within = np.arange(rows.sum()) - np.repeat(np.cumsum(rows) - rows, rows)
    numbers = np.repeat(first_row % 2**MOST_STRIDE, rows) + within
    mask: NDArray[np.bool_] = numbers[:, np.newaxis] % np.repeat(steps, rows, axis=0) == 0
    return mask.T


def _integers(value: object, what: str) -> NDArray[np.int64]:
    data = octets(value, what, 0, 8 * MOST_COLUMNS)
    if len(data) % 8:
        raise MessageError(f"{what} has {len(data)} bytes of integers")
    return np.frombuffer(data, np.int64)
