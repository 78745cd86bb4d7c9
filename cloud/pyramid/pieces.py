"""Pieces: runs of neighbouring samples, each summed up by what questions need of them."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Final, TypeAlias

import numpy as np
import pyarrow as pa

from cloud.query.span import longest_step
from eskin.kernels.summation import run_sums

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from eskin.interval import Floats


Integers: TypeAlias = "NDArray[np.int64]"
_CODEC: Final = "zstd"


@dataclass(frozen=True, slots=True)
class Pieces:
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

    def __getitem__(self, chosen: NDArray[np.bool_] | NDArray[np.intp] | slice) -> Pieces:
        """Some of them."""
        return Pieces(*(getattr(self, name)[chosen] for name in _NAMES))

    def grouped(self, key: Integers) -> Pieces:
        """One piece for each run of pieces with the same key.

        Args:
            key: Never falls.
        """
        if len(self) == 0:
            return self
        at = np.flatnonzero(np.diff(key, prepend=key[0] - 1))
        ends = np.append(at[1:], len(self)) - 1
        step = self.first[1:] - self.last[:-1]
        broken, shown = step > longest_step(self.dt[:-1]), np.minimum(step, self.dt[:-1])
        inner = np.ones(len(self), np.bool_)
        inner[at] = False  # the step to a group's first piece is none of the group's
        breaks, held = self.breaks.copy(), self.held.copy()
        breaks[1:] += broken & inner[1:]
        held[1:] += np.where(inner[1:], np.maximum(shown, 0), 0)
        sum_lo, sum_hi = np.empty(at.size), np.empty(at.size)
        run_sums(self.sum_lo, self.sum_hi, at, sum_lo, sum_hi)
        return Pieces(
            first=self.first[at],
            last=np.maximum.reduceat(self.last, at),
            n=np.add.reduceat(self.n, at),
            breaks=np.add.reduceat(breaks, at),
            dt=self.dt[ends],
            held=np.add.reduceat(held, at),
            error=np.maximum.reduceat(self.error, at),
            lo=np.minimum.reduceat(self.lo, at),
            hi=np.maximum.reduceat(self.hi, at),
            sum_lo=sum_lo,
            sum_hi=sum_hi,
            coverage=np.minimum.reduceat(self.coverage, at),
        )

    def pack(self) -> bytes:
        """As the store keeps them; how many they are comes first."""
        columns = np.stack([getattr(self, name).view(np.int64) for name in _NAMES])
        # Bytes of the same weight side by side: neighbours are much alike.
        body = columns.view(np.uint8).reshape(-1, 8).T.tobytes()
        packed: bytes = pa.compress(body, codec=_CODEC, asbytes=True)
        return len(self).to_bytes(4, "little") + packed

    @classmethod
    def unpack(cls, packed: Sequence[bytes]) -> Pieces:
        """What several chunks hold, in their order."""
        if not packed:
            return EMPTY
        columns = np.concatenate([_columns(data) for data in packed], axis=1)
        return cls(*columns[:_WHOLE], *columns[_WHOLE:].view(np.float64))


def concatenated(parts: Sequence[Pieces]) -> Pieces:
    """Several lots as one, in order of time."""
    parts = [part for part in parts if len(part)]
    if not parts:
        return EMPTY
    if len(parts) == 1:
        return parts[0]
    joined = Pieces(*(np.concatenate([getattr(p, name) for p in parts]) for name in _NAMES))
    return joined[np.argsort(joined.first, kind="stable")]


def _columns(data: bytes) -> Integers:
    size = len(_NAMES) * int.from_bytes(data[:4], "little") * 8
    body = np.frombuffer(pa.decompress(data[4:], size, codec=_CODEC), np.uint8)
    return np.ascontiguousarray(body.reshape(8, -1).T).view(np.int64).reshape(len(_NAMES), -1)


_NAMES: Final = tuple(field.name for field in fields(Pieces))
_WHOLE: Final = 7
"""So many columns are of whole numbers; the others are of floats."""
_NOTHING: Final = np.empty((len(_NAMES), 0), np.int64)
EMPTY: Final = Pieces(*_NOTHING[:_WHOLE], *_NOTHING[_WHOLE:].view(np.float64))
