"""Random numbers of columns: each is a function of seed, taxel and moment, drawn in any order.

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

    from numpy.typing import NDArray

    from eskin.interval import Floats

    Integers: TypeAlias = NDArray[np.int64]
    Word: TypeAlias = np.uint64

_WORD: Final = np.uint64(0xFFFFFFFF)
_HALF: Final = np.uint64(32)
_MULTIPLIERS: Final = np.uint64(0xD2511F53), np.uint64(0xCD9E8D57)
_WEYL: Final = np.uint64(0x9E3779B9), np.uint64(0xBB67AE85)
_ROUNDS: Final = 10
_MANTISSA: Final = np.uint64(11)
_UNIT: Final = 2.0**-53
_DRAWS: Final = 256
"""Draws of a moment, at most."""
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
def fill_uniform(key: Word, stream: Word, taxels: Integers, moments: Integers, out: Floats) -> None:
    """Fill taxels × moments with numbers from 0 to below 1."""
    for row in range(taxels.size):
        high = _counter(taxels[row], stream)
        for k in range(moments.size):
            out[row, k] = _fraction(block(np.uint64(moments[k]), high, key)[0])


@kernel
def fill_normal(key: Word, stream: Word, taxels: Integers, moments: Integers, out: Floats) -> None:
    """Fill taxels × moments with normal numbers of variance 1 (Box and Muller, 1958)."""
    for row in range(taxels.size):
        high = _counter(taxels[row], stream)
        for k in range(moments.size):
            one, other = block(np.uint64(moments[k]), high, key)
            radius = sqrt(-2.0 * log(1.0 - _fraction(one)))
            out[row, k] = radius * cos(2.0 * pi * _fraction(other))


class ColumnGenerator(np.random.Generator):
    """A random generator that draws for all taxels of a skin at once.

    Where a kind's code draws one number, it draws a column; where it draws several, taxels ×
    moments. So the kinds' own code draws true parts and noise.

    Args:
        seed: The node's, below 2^64.
        taxels: Numbers of the taxels, below 2^32.
    """

    def __init__(self, seed: int, taxels: Integers) -> None:
        super().__init__(np.random.PCG64(0))  # never drawn from: all that draws is below
        self._key = np.uint64(seed)
        self._taxels = taxels
        self._moments = np.zeros(0, np.int64)
        self._stream = self._drawn = 0

    def begin(self, boot: int, moments: Integers) -> None:
        """Draw the noise of some moments from now on, no more parts.

        Args:
            boot: The node's, below 2^23: after a reset its clock counts the same moments again.
            moments: On the node's clock, ns.
        """
        self._moments = moments
        self._stream, self._drawn = (boot + 1) * _DRAWS, 0

    def uniform(  # type: ignore[override]  # only what parts and noise need
        self, low: float, high: float, size: int | tuple[int, ...] | None = None
    ) -> Floats:
        """Uniform numbers: taxels × 1, or taxels × moments, or ``size`` times taxels × 1."""
        if isinstance(size, int):
            each = [self.uniform(low, high) for _ in range(size)]
            return np.array(each).reshape(size, len(self._taxels), 1)
        drawn = self._fill(fill_uniform)
        return low + (high - low) * drawn

    def normal(  # type: ignore[override]  # likewise
        self, loc: float, scale: float, size: tuple[int, ...] | None = None
    ) -> Floats:
        """Gaussian numbers, taxels × 1 or taxels × moments."""
        del size
        return loc + scale * self._fill(fill_normal)

    def _fill(self, fill: Callable[[Word, Word, Integers, Integers, Floats], None]) -> Floats:
        stream, moments = self._stream + self._drawn, self._moments
        if self._stream == _PARTS:
            stream, moments = _PARTS, np.array([self._drawn])
        self._drawn += 1
        out = np.empty((len(self._taxels), len(moments)))
        fill(self._key, np.uint64(stream), self._taxels, moments, out)
        return out
