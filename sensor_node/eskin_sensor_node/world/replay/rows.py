"""The rows of a recording, one after the other, each with its place in the file.

A recording has columns for time (``time`` or ``time_s`` in s, or ``time_ns``), ``channel``, and
either ``value`` or ``lo`` and ``hi``; others are passed over.
"""

from __future__ import annotations

import csv
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, Self

import pyarrow as pa
import pyarrow.parquet

from eskin.errors import RecordingError, shown
from eskin.wire.timestamp import SECOND

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

_TIMES: Final = {"time": SECOND, "time_s": SECOND, "time_ns": 1}
"""Column to its nanoseconds."""
_PLAIN: Final = (
    pa.types.is_integer,
    pa.types.is_floating,
    pa.types.is_decimal,
    pa.types.is_string,
    pa.types.is_large_string,
    lambda kind: pa.types.is_dictionary(kind) and pa.types.is_string(kind.value_type),
    pa.types.is_null,
)
"""Kinds of Parquet's columns that are read."""
_PIECE: Final = 65_536
_LATEST: Final = 2**62
"""In ns, either way."""


@dataclass(frozen=True, slots=True)
class Row:
    """One sample.

    Attributes:
        place: Such as ``line 17``.
        time: In ns.
        channel: Its channel.
        lo: Lower bound, or the value.
        hi: Upper bound, or the value.
    """

    place: str
    time: int
    channel: str
    lo: float
    hi: float


class RowError(ValueError):
    """A cell that cannot be read."""


@dataclass(frozen=True, slots=True)
class _Layout:
    """Which column is what."""

    time: str
    channel: str
    bounds: tuple[str, str]

    @classmethod
    def of(cls, path: Path, columns: Sequence[str]) -> Self:
        """Find the columns; reject missing and duplicate ones."""
        twice = sorted({name for name in columns if list(columns).count(name) > 1})
        if twice:
            raise RecordingError(path, "header", f"columns that stand twice: {_listed(twice)}")
        times = [name for name in _TIMES if name in columns]
        if len(times) != 1:
            raise _headless(path, columns, "one of time, time_s and time_ns")
        if "channel" not in columns:
            raise _headless(path, columns, "channel")
        valued, bounded = "value" in columns, {"lo", "hi"} <= set(columns)
        if valued == bounded:
            raise _headless(path, columns, "either value, or lo and hi")
        return cls(times[0], "channel", ("value", "value") if valued else ("lo", "hi"))

    @property
    def names(self) -> list[str]:
        """The columns that are read, each once."""
        return list(dict.fromkeys((self.time, self.channel, *self.bounds)))

    def row(self, place: str, cells: dict[str, Any]) -> Row:
        """Read one sample; raises `RowError`."""
        channel = cells[self.channel]
        if not channel or not isinstance(channel, str):
            raise RowError(f"channel is {shown(channel)}")
        time = _time(cells[self.time], _TIMES[self.time], self.time)
        lo, hi = (_number(cells[name], name) for name in self.bounds)
        if self.bounds[0] == "value" and math.isinf(lo):
            raise RowError(f"value is {lo!r}")
        if not lo <= hi or lo == math.inf or hi == -math.inf:
            raise RowError(f"lo = {lo!r} and hi = {hi!r} are no interval")
        return Row(place, time, channel, lo, hi)


def read_rows(path: Path) -> Iterator[Row]:
    """The rows of a CSV or Parquet file, by its suffix.

    Raises:
        RecordingError: A row cannot be read; those before it were given out.
    """
    try:
        yield from _parquet(path) if path.suffix == ".parquet" else _csv(path)
    except OSError as error:
        raise RecordingError(
            path, "file", f"it cannot be read: {error.strerror or error}"
        ) from error


def _csv(path: Path) -> Iterator[Row]:
    with path.open("rb") as file:
        layout: _Layout | None = None
        header: list[str] = []
        for number, line in enumerate(file, start=1):
            place = f"line {number}"
            cells = _cells(path, place, line)
            if layout is None:
                header = [cell.strip() for cell in cells]
                layout = _Layout.of(path, header)
            elif len(cells) != len(header):
                reason = f"{len(cells)} cells instead of {len(header)}"
                raise RecordingError(path, place, reason)
            else:
                yield _row(path, layout, place, dict(zip(header, cells, strict=True)))
        if layout is None:
            raise RecordingError(path, "file", "it is empty")


def _cells(path: Path, place: str, line: bytes) -> list[str]:
    if not line.endswith(b"\n"):
        raise RecordingError(path, place, "the file ends in the middle of this line")
    try:
        return next(csv.reader([line.decode()], strict=True), [])
    except (UnicodeDecodeError, csv.Error) as error:
        raise RecordingError(path, place, f"it is no CSV: {error}") from error


def _parquet(path: Path) -> Iterator[Row]:
    try:
        with pyarrow.parquet.ParquetFile(path) as file:
            layout = _Layout.of(path, file.schema_arrow.names)
            number = 0
            for batch in file.iter_batches(_PIECE, columns=layout.names):
                lost = sorted(set(layout.names) - set(batch.schema.names))
                if lost:  # a group of no columns has a name, and nothing to read
                    raise _headless(path, batch.schema.names, _listed(lost))
                _require_plain(path, batch.schema)
                for cells in batch.to_pylist():
                    number += 1
                    yield _row(path, layout, f"row {number}", cells)
    except (pa.ArrowException, UnicodeDecodeError) as error:  # names may be any bytes
        reason = str(error).splitlines()[0]
        raise RecordingError(path, "file", f"it is no whole Parquet file: {reason}") from error


def _require_plain(path: Path, schema: pa.Schema) -> None:
    """Refuse columns of dates, durations, lists and the like."""
    for column in schema:
        if not any(is_kind(column.type) for is_kind in _PLAIN):
            reason = f"{column.name} is {str(column.type)[:80]}, neither number nor text"
            raise RecordingError(path, "header", reason)


def _row(path: Path, layout: _Layout, place: str, cells: dict[str, Any]) -> Row:
    try:
        return layout.row(place, cells)
    except RowError as error:
        raise RecordingError(path, place, str(error)) from error


def _number(cell: Any, name: str) -> float:
    try:
        value = float(cell)
    except (TypeError, ValueError):
        raise RowError(f"{name} is {shown(cell)}, which is no number") from None
    if math.isnan(value):
        raise RowError(f"{name} is NaN")
    return value


def _time(cell: Any, unit: int, name: str) -> int:
    if unit == 1:
        try:
            time = int(cell)
        except (TypeError, ValueError, OverflowError):
            raise RowError(f"{name} is {shown(cell)}, which is no whole number") from None
        if time != cell and not isinstance(cell, str):
            raise RowError(f"{name} is {shown(cell)}, which is no whole number")
    else:
        seconds = _number(cell, name)
        # Comparing first: a float beyond the latest may be no whole number at all.
        time = round(seconds * unit) if abs(seconds) < _LATEST / unit else _LATEST
    if abs(time) >= _LATEST:
        raise RowError(f"{name} is {shown(cell)}, which is too far away")
    return time


def _headless(path: Path, columns: Sequence[str], wanted: str) -> RecordingError:
    return RecordingError(path, "header", f"it needs {wanted}; it has {_listed(columns)}")


def _listed(columns: Sequence[str]) -> str:
    """Names as a message shows them: a header may be anything."""
    return ", ".join(columns)[:80]
