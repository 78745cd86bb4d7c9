"""All true sets between the certain and the possible one, by plain Python.

A set of taxels is an integer with a bit for each. Nothing here is shared with what it tests.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from typing import TYPE_CHECKING, Final

import numpy as np

from eskin.contacts import Skin

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.typing import NDArray

    Floats = NDArray[np.float64]

THRESHOLD: Final = 1000.0
_BITS: Final = 160


@dataclass(frozen=True)
class Scene:
    """A skin with pressures at one instant."""

    skin: Skin
    lo: Floats
    hi: Floats

    @property
    def certain(self) -> int:
        return bits(np.flatnonzero(self.lo > THRESHOLD).tolist())

    @property
    def possible(self) -> int:
        return bits(np.flatnonzero(~(self.hi <= THRESHOLD)).tolist())


def draw_pressures(random: np.random.Generator, shape: tuple[int, ...]) -> tuple[Floats, Floats]:
    """Bounds that are above the threshold, around it, below it, or unknown."""
    kind = random.choice(4, shape, p=random.dirichlet([3.0, 4.0, 2.0, 1.0]))
    low, high = random.uniform(1.0, 900.0, (2, *shape))
    lo = np.choose(kind, [THRESHOLD + low, THRESHOLD - low, -low, np.full(shape, np.nan)])
    hi = np.choose(kind, [2000.0 + high, THRESHOLD + high, high, np.full(shape, np.nan)])
    return lo, hi


def draw_grid(random: np.random.Generator, most: int = 12) -> Skin:
    """A grid of at most so many taxels."""
    rows = int(random.integers(1, 4))
    columns = int(random.integers(1, most // rows + 1))
    areas = random.uniform(1e-6, 9e-6, rows * columns)
    return Skin.grid(rows, columns, pitch=random.uniform(1e-3, 5e-3), area=areas)


def draw_graph(random: np.random.Generator, most: int = 11) -> Skin:
    """Any graph: with odd cycles, taxels without neighbours, equal coordinates."""
    count = int(random.integers(4, most + 1))
    pairs = np.argwhere(np.triu(random.random((count, count)) < random.uniform(0.05, 0.6), 1))
    positions = random.choice([random.normal(size=(count, 2)), random.integers(0, 3, (count, 2))])
    return Skin.from_edges(positions, random.uniform(1e-6, 9e-6, count), pairs)


def adjacency(skin: Skin) -> list[int]:
    """The neighbours of each taxel."""
    ends = skin.starts.tolist()
    lists = skin.neighbours.tolist()
    return [bits(lists[ends[k] : ends[k + 1]]) for k in range(len(skin))]


def bits(numbers: Sequence[int]) -> int:
    return sum(1 << number for number in numbers)


def numbers(mask: int) -> list[int]:
    return [k for k in range(mask.bit_length()) if mask >> k & 1]


def components(mask: int, near: Sequence[int]) -> list[int]:
    """Connected components, in order of their lowest taxel."""
    found = []
    while mask:
        grown = mask & -mask
        front = grown
        while front:
            around = 0
            for k in numbers(front):
                around |= near[k]
            front = around & mask & ~grown
            grown |= front
        found.append(grown)
        mask &= ~grown
    return found


def between(certain: int, possible: int) -> Iterator[int]:
    """All sets between two."""
    open_ = possible & ~certain
    chosen = open_
    while True:
        yield certain | chosen
        if chosen == 0:
            return
        chosen = (chosen - 1) & open_


def exactly(values: Floats) -> list[int]:
    """Numbers as multiples of 2⁻¹⁶⁰."""
    exact = [Fraction(value) * 2**_BITS for value in values.tolist()]
    assert all(value.denominator == 1 for value in exact)
    return [int(value) for value in exact]


def total(mask: int, values: Sequence[int], factors: Sequence[int] | None = None) -> Fraction:
    """Sum over a set of what `exactly` gives, or of products."""
    if factors is None:
        return Fraction(sum(values[k] for k in numbers(mask)), 1 << _BITS)
    return Fraction(sum(values[k] * factors[k] for k in numbers(mask)), 1 << 2 * _BITS)


def component_with(taxels: int, parts: Sequence[int]) -> int:
    """The component that holds some taxels."""
    (one,) = (part for part in parts if part & taxels == taxels)
    return one
