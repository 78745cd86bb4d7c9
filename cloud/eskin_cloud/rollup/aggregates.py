"""Pieces: runs of neighbouring samples, each summed up by what questions need of them."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Final, TypeAlias

import numpy as np
import pyarrow as pa

from eskin_cloud.rollup.aggregate import fold_pieces, fold_samples, gather

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from eskin.interval import Floats


Integers: TypeAlias = "NDArray[np.int64]"
_CODEC: Final = "zstd"


@dataclass(frozen=True, slots=True)
class Aggregates:
    """Pieces in order of time; all arrays have one entry a piece.

    Attributes:
        first: The first sample's moment, UTC ns.
        last: The last sample's moment.
        n: How many samples.
        breaks: How many gaps lie between them.
        dt: The last sample's period in ns.
        held: For how long the others are drawn, in ns: until the next, a period at most.
        error: The greatest time error, in ns.
        lo: Least lower bound.
        hi: Greatest upper bound.
        sum_lo: The lower bounds' sum or less.
        sum_hi: The upper bounds' sum or more.
        coverage: The least coverage.
    """

    first: Integers
    last: Integers
    n: Integers
    breaks: Integers
    dt: Integers
    held: Integers
    error: Integers
    lo: Floats
    hi: Floats
    sum_lo: Floats
    sum_hi: Floats
    coverage: Floats

    def __len__(self) -> int:
        return self.first.size

    def __getitem__(self, chosen: NDArray[np.bool_] | NDArray[np.intp] | slice) -> Aggregates:
        """Some of them."""
        return Aggregates(*(getattr(self, name)[chosen] for name in _NAMES))

    def grouped(self, key: Integers) -> Aggregates:
        """One piece for each run of pieces with the same key.

        Args:
            key: Never falls.
        """
        if len(self) == 0:
            return self
        columns = [getattr(self, name) for name in _NAMES]
        whole, real = np.empty((_WHOLE, len(self)), np.int64), np.empty((_REAL, len(self)))
        n = fold_pieces(key, tuple(columns[:_WHOLE]), tuple(columns[_WHOLE:]), (whole, real))
        return Aggregates(*whole[:, :n], *real[:, :n])

    def pack(self) -> bytes:
        """As the store keeps them; how many they are comes first."""
        columns = np.stack([getattr(self, name).view(np.int64) for name in _NAMES])
        # Bytes of the same weight side by side: neighbours are much alike.
        body = columns.view(np.uint8).reshape(-1, 8).T.tobytes()
        packed: bytes = pa.compress(body, codec=_CODEC, asbytes=True)
        return len(self).to_bytes(4, "little") + packed

    @classmethod
    def unpack(cls, packed: Sequence[bytes]) -> Aggregates:
        """What several chunks hold, in their order."""
        if not packed:
            return EMPTY
        sizes = [int.from_bytes(data[:4], "little") for data in packed]
        columns, at = np.empty((len(_NAMES), sum(sizes)), np.int64), 0
        for data, n in zip(packed, sizes, strict=True):
            body = pa.decompress(memoryview(data)[4:], len(_NAMES) * n * 8, codec=_CODEC)
            gather(np.frombuffer(body, np.uint8), columns, at, n)
            at += n
        return cls(*columns[:_WHOLE], *columns[_WHOLE:].view(np.float64))

    @classmethod
    def of_samples(
        cls,
        bounds: tuple[Floats, Floats],
        runs: Integers,
        coverage: Floats,
        grid: tuple[int, int],
        most: int,
    ) -> Aggregates:
        """One piece for each bucket of a grid that holds any of some samples.

        Args:
            bounds: Of the samples.
            runs: Of blocks that follow each other, see `fold_samples`.
            coverage: Of each block.
            grid: Where a bucket begins, and how wide all are, in ns.
            most: Buckets there may be.
        """
        room = min(most, bounds[0].size)
        whole, real = np.empty((_WHOLE, room), np.int64), np.empty((_REAL, room))
        n = fold_samples(bounds, runs, coverage, grid, (whole, real))
        return cls(*whole[:, :n], *real[:, :n])


def concatenated(parts: Sequence[Aggregates]) -> Aggregates:
    """Several lots as one, in order of time."""
    parts = [part for part in parts if len(part)]
    if not parts:
        return EMPTY
    if len(parts) == 1:
        return parts[0]
    joined = Aggregates(*(np.concatenate([getattr(p, name) for p in parts]) for name in _NAMES))
    return joined[np.argsort(joined.first, kind="stable")]


_NAMES: Final = tuple(field.name for field in fields(Aggregates))
_WHOLE: Final = 7
"""So many columns are of whole numbers; the others are of floats."""
_REAL: Final = len(_NAMES) - _WHOLE
_NOTHING: Final = np.empty((len(_NAMES), 0), np.int64)
EMPTY: Final = Aggregates(*_NOTHING[:_WHOLE], *_NOTHING[_WHOLE:].view(np.float64))
