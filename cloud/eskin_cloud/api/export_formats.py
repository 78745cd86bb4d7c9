"""Exports as files, written while they are sent: CSV, Arrow (IPC stream) and Parquet."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import pyarrow as pa
import pyarrow.compute
import pyarrow.csv
import pyarrow.parquet

from eskin_cloud.store.read.window import clip

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping

    from eskin_cloud.query.export import ExportPart
    from eskin_cloud.store.read.window import Window

_INSTANT: Final = pa.timestamp("ns", tz="UTC")
_WORD: Final = pa.dictionary(pa.int32(), pa.string())
SCHEMA: Final = pa.schema(
    [
        pa.field("node", _WORD, nullable=False),
        pa.field("channel", _WORD, nullable=False),
        pa.field("earliest", _INSTANT, nullable=False),
        pa.field("latest", _INSTANT, nullable=False),
        pa.field("lo", pa.float64()),
        pa.field("hi", pa.float64()),
        pa.field("unit", _WORD, nullable=False),
        pa.field("coverage", pa.float64(), nullable=False),
        pa.field("dt", pa.int64(), nullable=False),
        pa.field("boot", pa.int64(), nullable=False),
        pa.field("sequence", pa.int64(), nullable=False),
    ]
)
"""A row is a sample: taken between ``earliest`` and ``latest``, enclosed by ``lo`` and ``hi`` with
``coverage``. Both are null where nothing is known. ``boot`` and ``sequence`` name the frame that
brought it; ``sequence`` is another number, which counts nothing, where the node has biometric
channels and the reader lacks the scope. ``dt`` is the sampling period in ns.
"""
_PLAIN: Final = pa.schema(
    [field.with_type(pa.string()) if field.type in {_WORD, _INSTANT} else field for field in SCHEMA]
)


class _Outlet(io.RawIOBase):
    """Takes what a writer writes, and gives it away piece by piece."""

    def __init__(self) -> None:
        super().__init__()
        self._parts: list[bytes] = []
        self._count = 0

    def writable(self) -> bool:
        """It takes bytes."""
        return True

    def write(self, data: Any, /) -> int:
        part = bytes(data)
        self._parts.append(part)
        self._count += len(part)
        return len(part)

    def tell(self) -> int:
        return self._count

    def take(self) -> bytes:
        """All that was written since the last time."""
        taken, self._parts = b"".join(self._parts), []
        return taken


def as_table(part: ExportPart, window: Window) -> Any:
    """The samples of a part that lie in a window, as an Arrow table (`SCHEMA`)."""
    runs = part.runs
    ends = [clip(run.t, run.dt, run.lo.size, window) for run in runs]
    cuts = [slice(first, last + 1) for first, last in ends]
    counts = [last + 1 - first for first, last in ends]

    def each(values: list[Any], kind: Any) -> Any:
        return np.repeat(np.asarray(values, kind), counts)

    dt, error = (
        each([run.dt for run in runs], np.int64),
        each([run.error for run in runs], np.int64),
    )
    number = np.concatenate([np.arange(first, last + 1) for first, last in ends])
    t = each([run.t for run in runs], np.int64) + number * dt
    lo = np.concatenate([run.lo[cut] for run, cut in zip(runs, cuts, strict=True)])
    hi = np.concatenate([run.hi[cut] for run, cut in zip(runs, cuts, strict=True)])
    missing = (lo == -np.inf) & (hi == np.inf)
    columns = [
        _constant(part.channel["node"], lo.size),
        _constant(part.channel["channel"], lo.size),
        pa.array(t - error).cast(_INSTANT),
        pa.array(t + error).cast(_INSTANT),
        pa.array(lo, mask=missing),
        pa.array(hi, mask=missing),
        _constant(part.channel["unit"], lo.size),
        pa.array(each([run.coverage for run in runs], np.float64)),
        pa.array(dt),
        pa.array(each([run.boot for run in runs], np.int64)),
        pa.array(each([part.number(run) for run in runs], np.int64)),
    ]
    return pa.Table.from_arrays(columns, schema=SCHEMA)


def _constant(word: str, count: int) -> Any:
    indices = pa.array(np.zeros(count, np.int32))
    return pa.DictionaryArray.from_arrays(indices, pa.array([word], pa.string()))


class _Csv:
    """Writes CSV: times in RFC 3339, unbounded sides as inf or -inf, missing ones empty."""

    def __init__(self, sink: object) -> None:
        options = pa.csv.WriteOptions(quoting_style="needed")
        self._writer = pa.csv.CSVWriter(sink, _PLAIN, write_options=options)

    def write_table(self, table: Any) -> None:
        columns = [
            _rfc3339(column) if column.type == _INSTANT else column.cast(field.type)
            for column, field in zip(table.columns, _PLAIN, strict=True)
        ]
        self._writer.write_table(pa.Table.from_arrays(columns, schema=_PLAIN))

    def close(self) -> None:
        self._writer.close()


def _rfc3339(instants: Any) -> Any:
    plain = instants.cast(pa.timestamp("ns"))
    return pa.compute.strftime(plain, format="%Y-%m-%dT%H:%M:%SZ")


def _arrow(sink: object) -> Any:
    options = pa.ipc.IpcWriteOptions(compression="zstd", emit_dictionary_deltas=True)
    return pa.ipc.new_stream(sink, SCHEMA, options=options)


WRITERS: Final[Mapping[str, Callable[[object], Any]]] = {
    "text/csv": _Csv,
    "application/vnd.apache.arrow.stream": _arrow,
    "application/vnd.apache.parquet": lambda sink: pyarrow.parquet.ParquetWriter(
        sink, SCHEMA, compression="zstd"
    ),
}
"""What writes each media type, in our order of preference."""


def write(media: str, parts: Iterable[ExportPart], window: Window) -> Iterator[bytes]:
    """Write a file while it is sent; at most one part of it is held at a time."""
    outlet = _Outlet()
    writer = WRITERS[media](outlet)
    for part in parts:
        writer.write_table(as_table(part, window))
        yield outlet.take()
    writer.close()
    yield outlet.take()
