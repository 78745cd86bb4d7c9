"""Series as files: JSON, CSV, Arrow (IPC stream), Parquet and SenML."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import pyarrow as pa
import pyarrow.parquet

from eskin.errors import QueryError
from eskin.wire import senml
from eskin.wire.timestamp import format_timestamp
from eskin_cloud.schemas.base import dump
from eskin_cloud.schemas.series import describe_series

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from eskin_cloud.query.series import Series


def as_json(series: Series) -> bytes:
    """JSON; an unbounded side is null, and both are where nothing is known."""
    return dump(describe_series(series))


def as_csv(series: Series) -> bytes:
    """CSV with ``time,lo,hi``: unbounded is inf or -inf, both are empty where nothing is known."""
    lines = ["time,lo,hi"]
    times, bounds = series.t.tolist(), zip(series.lo.tolist(), series.hi.tolist(), strict=True)
    for t, (lo, hi) in zip(times, bounds, strict=True):
        known = f"{lo!r},{hi!r}" if lo != -np.inf or hi != np.inf else ","
        lines.append(f"{format_timestamp(series.t0 + t)},{known}")
    return ("\r\n".join(lines) + "\r\n").encode()


def as_table(series: Series) -> Any:
    """An Arrow table: ``time`` (timestamp, ns, UTC), ``lo``, ``hi``; null where nothing is known.

    What else a series says stands in the schema's metadata.
    """
    missing = (series.lo == -np.inf) & (series.hi == np.inf)
    metadata = {
        "node": series.node,
        "channel": series.channel,
        "unit": series.unit,
        "coverage": repr(series.coverage),
        "resolution": series.resolution,
        "dt": str(series.dt),
        "time_error": str(series.time_error),
    }
    fields = [
        pa.field("time", pa.timestamp("ns", tz="UTC"), nullable=False),
        pa.field("lo", pa.float64()),
        pa.field("hi", pa.float64()),
    ]
    columns = [
        pa.array(series.t + series.t0, pa.int64()).cast(fields[0].type),
        pa.array(series.lo, mask=missing),
        pa.array(series.hi, mask=missing),
    ]
    return pa.Table.from_arrays(columns, schema=pa.schema(fields, metadata=metadata))


def as_arrow(series: Series) -> bytes:
    """Arrow's IPC stream."""
    table, sink = as_table(series), io.BytesIO()
    with pa.ipc.new_stream(sink, table.schema) as writer:
        writer.write_table(table)
    return sink.getvalue()


def as_parquet(series: Series) -> bytes:
    """Parquet."""
    sink = io.BytesIO()
    pyarrow.parquet.write_table(as_table(series), sink)
    return sink.getvalue()


def as_senml(series: Series) -> senml.Pack:
    """SenML (RFC 8428): a record ``lo`` and a record ``hi`` each, left out where unbounded.

    A hull holds from its time on for ``span`` s; a sample's true instant lies within ``time_error``
    s of its time.

    Raises:
        QueryError: It speaks of times that SenML would take for times before now.
    """
    if series.t0 < senml.EARLIEST:
        first = format_timestamp(senml.EARLIEST)
        raise QueryError("start", f"SenML has no times before {first}; request JSON")
    about = {
        "coverage": (series.coverage, senml.RATIO),
        "time_error": (senml.seconds(series.time_error), senml.SECONDS),
    }
    if series.resolution == "hull":
        about["span"] = (senml.seconds(series.dt), senml.SECONDS)
    bounds = series.t.tolist(), series.lo.tolist(), series.hi.tolist()
    name = f"{series.node}/{series.channel}/"
    return senml.Pack(name, series.unit, series.t0, *bounds, about)


WRITERS: Final[Mapping[str, Callable[[Series], bytes]]] = {
    "application/json": as_json,
    "text/csv": as_csv,
    "application/vnd.apache.arrow.stream": as_arrow,
    "application/vnd.apache.parquet": as_parquet,
    senml.JSON: lambda series: senml.as_json(as_senml(series)),
    senml.CBOR: lambda series: senml.as_cbor(as_senml(series)),
}
"""How each media type is written, in our order of preference."""
