"""Random numbers of columns: each is a function of seed, taxel and instant, drawn in any order.

The generator is Philox4x32-10. Source: Salmon, Moraes, Dror, Shaw, "Parallel random numbers: as
easy as 1, 2, 3", SC'11 (2011). A block of 128 bits is two uniform numbers, or one normal one.
"""

from __future__ import annotations

from math import cos, log, pi, sqrt
from typing import TYPE_CHECKING, Final, TypeAlias

import numpy as np

from eskin.kernels.jit import kernel, part

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import ArrayLike, NDArray

    from eskin.interval import Floats

    Integers: TypeAlias = NDArray[np.int64]
    Word: TypeAlias = np.uint64
    Words: TypeAlias = NDArray[np.uint64]

_WORD: Final = np.uint64(0xFFFFFFFF)
_HALF: Final = np.uint64(32)
_MULTIPLIERS: Final = np.uint64(0xD2511F53), np.uint64(0xCD9E8D57)
_WEYL: Final = np.uint64(0x9E3779B9), np.uint64(0xBB67AE85)
_ROUNDS: Final = 10
_MANTISSA: Final = np.uint64(11)
_UNIT: Final = 2.0**-53
_DRAWS: Final = 256
"""Draws of an instant, at most."""
_PARTS: Final = 0
"""Stream of what is drawn once; noise has those after it, `_DRAWS` for each boot."""


@part
def block(low: Word, high: Word, key: Word) -> tuple[Word, Word]:
    """A block of Philox4x32-10: words of a 128-bit counter, ascending, under a 64-bit key."""
    x0, x1 = low & _WORD, low >> _HALF
    x2, x3 = high & _WORD, high >> _HALF
    k0, k1 = key & _WORD, key >> _HALF
    for _ in range(_ROUNDS):
        first, second = _MULTIPLIERS[0] * x0, _MULTIPLIERS[1] * x2
        x0, x1 = (second >> _HALF) ^ x1 ^ k0, second & _WORD
        x2, x3 = (first >> _HALF) ^ x3 ^ k1, first & _WORD
        k0, k1 = (k0 + _WEYL[0]) & _WORD, (k1 + _WEYL[1]) & _WORD
    return (x1 << _HALF) | x0, (x3 << _HALF) | x2


@part
def _fraction(bits: Word) -> float:
    """A multiple of 2^-53 from 0 to below 1."""
    return float(bits >> _MANTISSA) * _UNIT


@part
def _counter(taxel: int, stream: Word) -> Word:
    return (stream << _HALF) | np.uint64(taxel)


@kernel
def fill_uniform(
    keys: Words, streams: Words, taxels: Integers, instants: Integers, out: Floats
) -> None:
    """Fill columns × instants with numbers from 0 to below 1."""
    for row in range(taxels.size):
        high = _counter(taxels[row], streams[row])
        for k in range(instants.size):
            out[row, k] = _fraction(block(np.uint64(instants[k]), high, keys[row])[0])


@kernel
def fill_normal(
    keys: Words, streams: Words, taxels: Integers, instants: Integers, out: Floats
) -> None:
    """Fill columns × instants with normal numbers of variance 1 (Box and Muller, 1958)."""
    for row in range(taxels.size):
        high = _counter(taxels[row], streams[row])
        for k in range(instants.size):
            one, other = block(np.uint64(instants[k]), high, keys[row])
            radius = sqrt(-2.0 * log(1.0 - _fraction(one)))
            out[row, k] = radius * cos(2.0 * pi * _fraction(other))


class ColumnGenerator:
    """Draws true parts and noise of columns: taxels of one node, or one taxel of many nodes.

    Args:
        seeds: Of the columns' nodes, below 2^64; or one for all.
        taxels: Numbers of the columns' taxels in their nodes, below 2^32; or one for all.
    """

    def __init__(self, seeds: ArrayLike, taxels: ArrayLike) -> None:
        keys, numbers = np.asarray(seeds, np.uint64), np.asarray(taxels, np.int64)
        self._shape = np.broadcast_shapes(keys.shape, numbers.shape, (1,))
        self._keys = np.broadcast_to(keys, self._shape).copy()
        self._taxels = np.broadcast_to(numbers, self._shape).copy()
        self._streams = np.full(self._shape, _PARTS, np.uint64)
        self._instants: Integers | None = None
        self._drawn = 0

    def __len__(self) -> int:
        return int(self._shape[0])

    def begin(self, boots: ArrayLike, instants: Integers) -> None:
        """Draw the noise of some instants from now on, no more parts.

        Args:
            boots: The nodes', below 2^23, or one for all: after a reset a clock counts the same
                instants again.
            instants: On the nodes' clocks, ns.
        """
        first = (np.asarray(boots, np.uint64) + np.uint64(1)) * np.uint64(_DRAWS)
        self._streams = np.broadcast_to(first, self._shape).copy()
        self._instants, self._drawn = instants, 0

    def uniform(self, low: float, high: float, size: int | None = None) -> Floats:
        """Uniform numbers.

        Returns:
            A part of each column, columns × 1, or so many, size × columns × 1; once `begin` was
            called, noise of columns × instants.
        """
        drawn = low + (high - low) * self._fill(fill_uniform, 1 if size is None else size)
        return np.asarray(drawn if size is None else drawn.T[:, :, None])

    def normal(self, loc: float, scale: float) -> Floats:
        """Gaussian noise of columns × instants."""
        return np.asarray(loc + scale * self._fill(fill_normal, 1))

    def _fill(
        self, fill: Callable[[Words, Words, Integers, Integers, Floats], None], count: int
    ) -> Floats:
        if self._instants is None:
            streams, instants = self._streams, np.arange(self._drawn, self._drawn + count)
        else:
            streams, instants = self._streams + np.uint64(self._drawn), self._instants
        self._drawn += count
        out = np.empty((len(self), len(instants)))
        fill(self._keys, streams, self._taxels, instants, out)
        return out
