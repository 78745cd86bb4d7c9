"""Aggregates of all columns of a patch, and their bytes.

Times and counts are those of the rows, so columns that are sampled together have the same ones;
they are kept once. Hulls are in the codes of the samples, in whole quanta, so they are exact where
the samples' are; sums are kept as means, rounded outward to a sixteenth of the quantum.
"""

from __future__ import annotations

from dataclasses import fields
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import cbor2
import numpy as np

from eskin.errors import MessageError
from eskin.wire.frames.column_codec import ColumnCodes, decode_columns, encode_columns
from eskin.wire.frames.sample_codec import COARSEST, FINEST, MOST_COLUMNS
from eskin.wire.messages.cbor_map import integer, items, load_any, octets, row
from eskin_cloud.rollup.aggregates import EMPTY, Aggregates
from eskin_cloud.store.patch_rows import compress, decompress

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from eskin.interval import Floats
    from eskin_cloud.rollup.aggregates import Integers

_NAMES: Final = tuple(field.name for field in fields(Aggregates))
_WHOLE: Final = _NAMES[:7]
_MEAN_BITS: Final = 4
_MOST_BYTES: Final = 2**24
_HASH_BYTES: Final = 64


class ColumnAggregates(NamedTuple):
    """Aggregates of all columns of a patch as one description has them.

    Attributes:
        columns: How many there are.
        finest: Least exponent of a quantum.
        column: Of each entry, ascending.
        pieces: The entries; those of a column in order of time.
    """

    columns: int
    finest: int
    column: Integers
    pieces: Aggregates

    def of(self, column: int) -> Aggregates:
        """The entries of one column."""
        begin, end = np.searchsorted(self.column, (column, column + 1)).tolist()
        return self.pieces[slice(begin, end)]

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


def joined(parts: Sequence[ColumnAggregates]) -> ColumnAggregates:
    """The entries of several parts of one description, in order."""
    column = np.concatenate([part.column for part in parts])
    pieces = chained([part.pieces for part in parts])
    order = np.lexsort((pieces.first, column))
    return parts[0]._replace(column=column[order], pieces=pieces[order])


def chained(parts: Sequence[Aggregates]) -> Aggregates:
    """Aggregates one after the other, as they are."""
    return Aggregates(*(np.concatenate([getattr(part, name) for part in parts]) for name in _NAMES))


def pack(sections: Mapping[bytes, ColumnAggregates]) -> bytes:
    """Serialise and compress the aggregates of a chunk, by the hash of their description."""
    return compress(cbor2.dumps([[name, *_section(each)] for name, each in sections.items()]))


def unpack(data: bytes) -> dict[bytes, PackedAggregates]:
    """Read what `pack` gave; the entries are decoded as they are asked for.

    Raises:
        MessageError: The bytes are something else.
    """
    found = {}
    for each in items(load_any(decompress(data, _MOST_BYTES), "tiles"), "tiles", 2**16):
        name, *parts = row(each, "tiles of a description", 9)
        found[octets(name, "hash", 1, _HASH_BYTES)] = _unpacked(parts)
    return found


class PackedAggregates(NamedTuple):
    """Aggregates of a chunk whose bounds are still encoded.

    Attributes:
        finest: Least exponent of a quantum.
        kind: Of each column, which times are its own.
        start: Of each column, the time of its first sample.
        begins: Of each kind, where its times begin.
        times: Integers of `Aggregates` and the bits of the coverage, shape ``(8, entries)``; times
            count from the start of their column.
        hulls: The hulls.
        means: The means.
    """

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
        counts = self.counts
        if not counts[column]:
            return EMPTY
        return self._entries([column], counts)

    def all(self) -> ColumnAggregates:
        """The entries of all columns.

        Raises:
            MessageError: Codes are not those of any entries.
        """
        counts = self.counts
        column = np.repeat(np.arange(self.kind.size), counts)
        pieces = self._entries(range(self.kind.size), counts)
        return ColumnAggregates(self.kind.size, self.finest, column, pieces)

    def bounds(self) -> tuple[Integers, Integers, Floats, Floats]:
        """Column, time of the first sample, and hull of each entry.

        Raises:
            MessageError: Codes are not those of any entries.
        """
        counts = self.counts
        column = np.repeat(np.arange(self.kind.size), counts)
        first = self.times[0, self._places(range(self.kind.size))] + self.start[column]
        return column, first, *decode_columns(self.hulls, counts)

    def _places(self, columns: Sequence[int]) -> Integers:
        """Where the times of some columns' entries stand."""
        kinds = self.kind[list(columns)].tolist()
        return np.concatenate([np.arange(self.begins[k], self.begins[k + 1]) for k in kinds])

    def _entries(self, columns: Sequence[int], counts: Integers) -> Aggregates:
        if not counts[list(columns)].sum():
            return EMPTY
        whole = self.times[:, self._places(columns)]
        whole[:2] += np.repeat(self.start[list(columns)], counts[list(columns)])
        lo, hi = decode_columns(self.hulls, counts, columns)
        low, high = decode_columns(self.means, counts, columns)
        n, coverage = whole[2], whole[7].view(np.float64)
        sums = np.nextafter(n * low, -np.inf), np.nextafter(n * high, np.inf)
        return Aggregates(*whole[:7], lo, hi, sums[0], sums[1], coverage)


def _section(each: ColumnAggregates) -> list[object]:
    counts = np.bincount(each.column, minlength=each.columns)
    begins = np.cumsum(counts) - counts
    pieces = each.pieces
    times = np.stack([*(getattr(pieces, name) for name in _WHOLE), pieces.coverage.view(np.int64)])
    start = np.zeros(each.columns, np.int64)
    some = counts > 0
    start[some] = pieces.first[begins[some]]
    times[:2] -= start[each.column]
    kinds: dict[bytes, int] = {}
    kind, distinct = [], []
    for begin, count in zip(begins.tolist(), counts.tolist(), strict=True):
        mine = times[:, begin : begin + count]
        number = kinds.setdefault(mine.tobytes(), len(kinds))
        if number == len(distinct):
            distinct.append(mine)
        kind.append(number)
    low = np.nextafter(pieces.sum_lo / pieces.n, -np.inf)
    high = np.nextafter(pieces.sum_hi / pieces.n, np.inf)
    return [
        each.finest,
        bytes(kind),
        start.tobytes(),
        [mine.shape[1] for mine in distinct],
        _planes(np.diff(np.concatenate(distinct, axis=1), axis=1, prepend=0)),
        _codes(encode_columns(pieces.lo, pieces.hi, counts, each.finest)),
        _codes(encode_columns(low, high, counts, max(each.finest - _MEAN_BITS, FINEST))),
        each.columns,
    ]


def _unpacked(parts: list[object]) -> PackedAggregates:
    finest, kind, start, sizes, planes, hulls, means, columns = parts
    count = integer(columns, "columns", 1, MOST_COLUMNS)
    kinds = np.frombuffer(octets(kind, "kinds", count, count), np.uint8).astype(np.int64)
    listed = [integer(each, "size", 0, 2**20) for each in items(sizes, "sizes", MOST_COLUMNS)]
    begins = np.concatenate([[0], np.cumsum(np.array(listed, np.int64))])
    total = int(begins[-1])
    data = octets(planes, "times", 64 * total, 64 * total)
    if kinds.max() >= len(listed):
        raise MessageError("a column has times that are not there")
    numbers = np.frombuffer(data, np.uint8).reshape(8, -1).T.copy().view(np.int64)
    return PackedAggregates(
        finest=integer(finest, "exponent", FINEST, COARSEST),
        kind=kinds,
        start=np.frombuffer(octets(start, "starts", 8 * count, 8 * count), np.int64),
        begins=begins,
        times=np.cumsum(numbers.reshape(8, total), axis=1),
        hulls=_decoded(hulls, count),
        means=_decoded(means, count),
    )


def _codes(encoded: ColumnCodes) -> list[object]:
    return [*(each.tobytes() for each in encoded[:3]), encoded.codes]


def _decoded(value: object, columns: int) -> ColumnCodes:
    *arrays, codes = row(value, "codes", 4)
    size = 8 * columns
    exponents, offsets, sizes = (
        np.frombuffer(octets(each, "codes", size, size), np.int64) for each in arrays
    )
    return ColumnCodes(exponents, offsets, sizes, octets(codes, "codes", 0, _MOST_BYTES))


def _planes(numbers: Integers) -> bytes:
    """The bytes of numbers, those of one weight together: most are zero."""
    return np.ascontiguousarray(numbers).view(np.uint8).reshape(-1, 8).T.tobytes()
