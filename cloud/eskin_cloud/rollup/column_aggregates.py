"""Aggregates of all columns of a patch, and their bytes.

Times and counts are those of the rows, so columns that are sampled together have the same ones;
they are kept once. Hulls are in the codes of the samples, in whole quanta, so they are exact where
the samples' are; sums are kept as means, rounded outward to a sixteenth of the quantum.

Each time a chunk changes, all sums in it are written anew. So a sum that is a whole number of
quanta times its count must give the same quanta again, or bounds would drift apart.
"""

from __future__ import annotations

from dataclasses import fields
from itertools import accumulate
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import cbor2
import numpy as np

from eskin.errors import MessageError
from eskin.kernels.jit import kernel
from eskin.kernels.outward_rounding import mul_down
from eskin.wire.frames.column_codec import (
    ColumnCodes,
    columns_of,
    decode_columns,
    encode_columns,
)
from eskin.wire.frames.sample_codec import COARSEST, FINEST
from eskin.wire.messages.cbor_map import integer, items, load_any, octets, row
from eskin_cloud.rollup.aggregates import EMPTY, Aggregates
from eskin_cloud.store.patch_rows import compress, decompress

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from numpy.typing import NDArray

    from eskin.interval import Floats
    from eskin_cloud.rollup.aggregates import Integers

_NAMES: Final = tuple(field.name for field in fields(Aggregates))
_WHOLE: Final = _NAMES[:6]
FIRST, LAST, COUNT, BREAKS, PERIOD, ERROR, COVERAGE = range(7)
"""Where each integer of an entry stands: those of `Aggregates`, and the bits of its coverage."""
_TIMES: Final = 7
_HEADS: Final = 8
"""Integers of a column: kind, start, and exponent, offset and size of hulls and of means."""
_MEAN_BITS: Final = 4
_MOST_BYTES: Final = 2**24
_HASH_BYTES: Final = 64
_COLUMNS: Final = 2**15
"""More channels than a node may have."""


@kernel
def _multiply_down(n: Integers, means: Floats) -> Floats:
    """Lower bounds of counts times means."""
    sums = np.empty(n.size)
    for k in range(n.size):
        sums[k] = means[k] if np.isinf(means[k]) else mul_down(np.float64(n[k]), means[k])
    return sums


@kernel
def divide_down(sums: Floats, n: Integers, exponent: int) -> Floats:
    """Divide sums by counts, rounded down to quanta of ``2^exponent``.

    A mean times its count is no more than the sum.
    """
    means, quantum = np.empty(n.size), 2.0**exponent
    for k in range(n.size):
        count = np.float64(n[k])
        mean = sums[k] / count
        if not np.isinf(mean):
            scaled = mean * 2.0**-exponent
            if abs(scaled) < 2.0**52:
                mean = (np.floor(scaled) + 1.0) * quantum
            for _ in range(3):
                if mul_down(count, mean) <= sums[k]:
                    break
                mean = min(mean - quantum, np.nextafter(mean, -np.inf))
        means[k] = mean
    return means


class ColumnAggregates(NamedTuple):
    """Aggregates of all columns of a patch.

    Attributes:
        names: Hashes of the descriptions by which the samples were read.
        taxels: Of each column: those of the descriptions, each once.
        finest: Least exponent of a quantum.
        column: Of each entry, ascending.
        pieces: The entries; those of a column in order of time.
    """

    names: tuple[bytes, ...]
    taxels: tuple[str, ...]
    finest: int
    column: Integers
    pieces: Aggregates

    def chosen(self, here: Any) -> ColumnAggregates:
        """The entries that a mask chooses."""
        return self._replace(column=self.column[here], pieces=self.pieces[here])

    def grouped(self, level: int) -> ColumnAggregates:
        """Aggregate the entries of each column that begin in one tile of a level."""
        if not len(self.pieces):
            return self
        tile = self.pieces.first >> level
        first = np.concatenate([[True], (np.diff(tile) != 0) | (np.diff(self.column) != 0)])
        pieces = self.pieces.grouped(np.cumsum(first))
        return self._replace(column=self.column[first], pieces=pieces)


def united(taxels: Iterable[Sequence[str]]) -> tuple[str, ...]:
    """The taxels of several descriptions, each once."""
    return tuple(dict.fromkeys(taxel for each in taxels for taxel in each))


def joined(parts: Sequence[ColumnAggregates]) -> ColumnAggregates:
    """The entries of several parts, in order."""
    parts = [part for part in parts if len(part.pieces)] or list(parts[:1])
    taxels = united(part.taxels for part in parts)
    number = {taxel: k for k, taxel in enumerate(taxels)}
    columns = [np.array([number[taxel] for taxel in part.taxels])[part.column] for part in parts]
    column, pieces = np.concatenate(columns), chained([part.pieces for part in parts])
    order = np.lexsort((pieces.first, column))
    return ColumnAggregates(
        names=tuple(dict.fromkeys(name for part in parts for name in part.names)),
        taxels=taxels,
        finest=min(part.finest for part in parts),
        column=column[order],
        pieces=pieces[order],
    )


def chained(parts: Sequence[Aggregates]) -> Aggregates:
    """Aggregates one after the other, as they are."""
    return Aggregates(*(np.concatenate([getattr(part, name) for part in parts]) for name in _NAMES))


def pack(aggregates: ColumnAggregates) -> bytes:
    """Serialise and compress the aggregates of a chunk."""
    return compress(cbor2.dumps([list(aggregates.names), *_parts(aggregates)]))


def unpack(data: bytes) -> PackedAggregates:
    """Read what `pack` gave; the entries are decoded as they are asked for.

    Raises:
        MessageError: The bytes are something else.
    """
    names, *parts = row(load_any(decompress(data, _MOST_BYTES), "tiles"), "tiles", 7)
    listed = [octets(each, "hash", 1, _HASH_BYTES) for each in items(names, "hashes", _COLUMNS)]
    return _unpacked(tuple(listed), parts)


class PackedAggregates(NamedTuple):
    """Aggregates of a chunk whose bounds are still encoded.

    Attributes:
        names: Hashes of the descriptions by which the samples were read; their taxels, each once,
            are the columns.
        finest: Least exponent of a quantum.
        kind: Of each column, which times are its own.
        start: Of each column, the time of its first sample.
        begins: Of each kind, where its times begin.
        times: Integers of `Aggregates` and the bits of the coverage, shape ``(7, entries)``; times
            count from the start of their column.
        hulls: The hulls.
        means: The means.
    """

    names: tuple[bytes, ...]
    finest: int
    kind: Integers
    start: Integers
    begins: Integers
    times: Integers
    hulls: ColumnCodes
    means: ColumnCodes

    @property
    def counts(self) -> Integers:
        """How many entries each column has."""
        return np.diff(self.begins)[self.kind]

    def of(self, column: int) -> Aggregates:
        """The entries of one column.

        Raises:
            MessageError: Its codes are not those of any entries.
        """
        return read_columns([(self, column)])

    def all(self, taxels: tuple[str, ...]) -> ColumnAggregates:
        """The entries of all columns.

        Args:
            taxels: Of each column.

        Raises:
            MessageError: Codes are not those of any entries.
        """
        column, whole, lo, hi = self.hulls_and_times()
        means = decode_columns(self.means, self.counts)
        pieces = _as_aggregates(whole, (lo, hi), means)
        return ColumnAggregates(self.names, taxels, self.finest, column, pieces)

    def hulls_and_times(self) -> tuple[Integers, Integers, Floats, Floats]:
        """Column, integers of `Aggregates` and bits of the coverage, and hull of each entry.

        Raises:
            MessageError: Codes are not those of any entries.
        """
        counts = self.counts
        column, whole = np.empty(counts.sum(), np.int64), np.empty((_TIMES, counts.sum()), np.int64)
        _repeat(self.times, (self.kind, self.start, self.begins), column, whole)
        return column, whole, *decode_columns(self.hulls, counts)


def read_columns(chosen: Sequence[tuple[PackedAggregates, int]]) -> Aggregates:
    """The entries of a column of each of some chunks, one after the other.

    All are decoded at once: of a chunk with one column little else is to be done.

    Args:
        chosen: Chunks, and the column of each.

    Raises:
        MessageError: Codes are not those of any entries.
    """
    if not chosen:
        return EMPTY
    parts = []
    for chunk, column in chosen:
        kind = chunk.kind[column]
        mine = chunk.times[:, chunk.begins[kind] : chunk.begins[kind + 1]].copy()
        mine[:2] += chunk.start[column]
        parts.append(mine)
    counts = np.array([each.shape[1] for each in parts])
    hulls = columns_of([(chunk.hulls, column) for chunk, column in chosen])
    means = columns_of([(chunk.means, column) for chunk, column in chosen])
    whole = np.concatenate(parts, axis=1)
    return _as_aggregates(whole, decode_columns(hulls, counts), decode_columns(means, counts))


def _as_aggregates(
    whole: Integers, hulls: tuple[Floats, Floats], means: tuple[Floats, Floats]
) -> Aggregates:
    n, coverage = whole[COUNT], whole[COVERAGE].view(np.float64)
    sums = _multiply_down(n, means[0]), -_multiply_down(n, -means[1])
    return Aggregates(*[*whole[:6], *hulls, *sums, coverage])


@kernel
def _repeat(
    times: Integers,
    columns: tuple[Integers, Integers, Integers],
    column: Integers,
    whole: Integers,
) -> None:
    """Write each column's number and times, column after column."""
    kinds, starts, begins = columns
    place = 0
    for k in range(kinds.size):
        begin, end = begins[kinds[k]], begins[kinds[k] + 1]
        size = end - begin
        for part in range(_TIMES):
            start = starts[k] if part < 2 else np.int64(0)
            for at in range(size):
                whole[part, place + at] = times[part, begin + at] + start
        column[place : place + size] = k
        place += size


def _parts(each: ColumnAggregates) -> list[object]:
    counts = np.bincount(each.column, minlength=len(each.taxels))
    begins = np.cumsum(counts) - counts
    pieces = each.pieces
    times = np.stack([*(getattr(pieces, name) for name in _WHOLE), pieces.coverage.view(np.int64)])
    start = np.zeros(counts.size, np.int64)
    some = counts > 0
    start[some] = pieces.first[begins[some]]
    times[:2] -= start[each.column]
    kinds: dict[bytes, int] = {}
    kind: list[int] = []
    distinct: list[Integers] = []
    for begin, count in zip(begins.tolist(), counts.tolist(), strict=True):
        mine = times[:, begin : begin + count]
        number = kinds.setdefault(mine.tobytes(), len(kinds))
        if number == len(distinct):
            distinct.append(mine)
        kind.append(number)
    finer = max(each.finest - _MEAN_BITS, FINEST)
    low = divide_down(pieces.sum_lo, pieces.n, finer)
    high = -divide_down(-pieces.sum_hi, pieces.n, finer)
    hulls = encode_columns(pieces.lo, pieces.hi, counts, each.finest)
    means = encode_columns(low, high, counts, finer)
    return [
        each.finest,
        np.array([kind, start, *hulls[:3], *means[:3]], np.int64).tobytes(),
        [mine.shape[1] for mine in distinct],
        _planes(np.diff(np.concatenate(distinct, axis=1), axis=1, prepend=0)),
        hulls.codes,
        means.codes,
    ]


def _unpacked(names: tuple[bytes, ...], parts: list[object]) -> PackedAggregates:
    finest, heads, sizes, planes, hulls, means = parts
    columns = _integers(heads, _HEADS)
    kinds = columns[0]
    listed = [integer(each, "size", 0, 2**20) for each in items(sizes, "sizes", _COLUMNS)]
    begins = np.array([0, *accumulate(listed)])
    total = sum(listed)
    data = octets(planes, "times", 8 * _TIMES * total, 8 * _TIMES * total)
    if not kinds.size or kinds.min() < 0 or kinds.max() >= len(listed):
        raise MessageError("a column has times that are not there")
    numbers = np.frombuffer(data, np.uint8).reshape(8, -1).T.copy().view(np.int64)
    return PackedAggregates(
        names=names,
        finest=integer(finest, "exponent", FINEST, COARSEST),
        kind=kinds,
        start=columns[1],
        begins=begins,
        times=np.cumsum(numbers.reshape(_TIMES, total), axis=1),
        hulls=_codes_of(columns[2:5], hulls),
        means=_codes_of(columns[5:], means),
    )


def _integers(value: object, rows: int) -> Integers:
    data = octets(value, "numbers of columns", 0, 8 * rows * _COLUMNS)
    if len(data) % (8 * rows):
        raise MessageError(f"numbers of columns have {len(data)} bytes")
    return np.frombuffer(data, np.int64).reshape(rows, -1)


def _planes(numbers: NDArray[Any]) -> bytes:
    """The bytes of numbers, those of one weight together: most are zero."""
    return np.ascontiguousarray(numbers).view(np.uint8).reshape(-1, 8).T.tobytes()


def _codes_of(heads: Integers, codes: object) -> ColumnCodes:
    exponents, offsets, sizes = heads
    return ColumnCodes(exponents, offsets, sizes, octets(codes, "codes", 0, _MOST_BYTES))
