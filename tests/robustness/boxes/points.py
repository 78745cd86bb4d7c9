"""Members of a box at which to look: corners, inner points, and where a result is extreme."""

from __future__ import annotations

import math
from fractions import Fraction
from typing import TYPE_CHECKING, Any, Final

from flint import arb, fmpq

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

    from numpy.random import Generator

    Sides = Mapping[str, tuple[float, float]]
    Point = dict[str, Any]
    Find = Callable[[Point], Any]

_GOLDEN: Final = 0.3819660112501051
_STEPS: Final = 10


def exactly(value: Fraction) -> Any:
    """A fraction as an enclosure of the present number of bits."""
    return arb(fmpq(value.numerator, value.denominator))


def corner(sides: Sides, generator: Generator) -> Point:
    """All coordinates at an end."""
    ends = generator.integers(0, 2, len(sides))
    return {name: arb(side[end]) for (name, side), end in zip(sides.items(), ends, strict=True)}


def inside(sides: Sides, generator: Generator) -> Point:
    """Half of the coordinates at an end, the others anywhere between."""
    point = corner(sides, generator)
    for name, (lo, hi) in sides.items():
        if lo < hi and generator.random() < 0.6:
            point[name] = arb(_between(lo, hi, float(generator.random()), generator.random() < 0.5))
    return point


def _between(lo: float, hi: float, share: float, logarithmic: bool) -> float:  # noqa: FBT001
    if logarithmic and lo > 0.0:
        value = math.exp(math.log(lo) + share * (math.log(hi) - math.log(lo)))
    else:
        value = lo * (1.0 - share) + hi * share
    return min(max(value, lo), hi)


def crests(sides: Sides, generator: Generator) -> Iterator[Point]:
    """Where ``2 f t`` is half an odd number exactly, so that ``sin(2π f t)`` is 1 or -1."""
    if all(lo == hi for lo, hi in (sides["time"], sides["frequency"])):
        return
    t_lo, t_hi = (Fraction(x) for x in sides["time"])
    for place in (Fraction(1, 2), Fraction(-1, 2)):
        point = inside(sides, generator)
        f = Fraction(_float_of(point["frequency"]))
        if f == 0:
            continue
        first, last = math.ceil((2 * f * t_lo - place) / 2), math.floor((2 * f * t_hi - place) / 2)
        if first <= last:
            turn = first + int(generator.random() * (last - first))
            yield {**point, "time": exactly((place + 2 * turn) / (2 * f))}
        t = Fraction(_float_of(point["time"]))
        f_lo, f_hi = (Fraction(x) for x in sides["frequency"])
        if t > 0:
            first = math.ceil((2 * f_lo * t - place) / 2)
            last = math.floor((2 * f_hi * t - place) / 2)
            if first <= last:
                yield {**point, "frequency": exactly((place + 2 * first) / (2 * t))}


def phases(sides: Sides, generator: Generator, response: Find) -> Iterator[Point]:
    """Where the phase makes a response extreme that is ``a·sin ψ + b·cos ψ``."""
    lo, hi = sides["phase"]
    if lo == hi:
        return
    for _ in range(3):
        point = inside(sides, generator)
        a = response({**point, "phase": arb.pi() / 2})
        b = response({**point, "phase": arb(0)})
        best = arb.atan2(a, b)
        k = ((arb(lo) - best) / arb.pi()).ceil().unique_fmpz()
        if k is None:
            continue
        for step in (int(k), int(k) + 1):
            psi = best + step * arb.pi()
            if psi >= arb(lo) and psi <= arb(hi):
                yield {**point, "phase": psi}


def climb(sides: Sides, start: Point, find: Find, sign: float) -> Point:
    """Go up (``sign`` 1) or down along one coordinate after the other."""
    point = dict(start)
    for name, (lo, hi) in sides.items():
        if lo == hi:
            continue

        def height(share: float, name: str = name, lo: float = lo, hi: float = hi) -> float:
            value = find({**point, name: arb(_between(lo, hi, share, lo > 0.0))})
            return sign * _float_of(value)

        left, right = 0.0, 1.0
        a, b = _GOLDEN, 1.0 - _GOLDEN
        height_a, height_b = height(a), height(b)
        for _ in range(_STEPS):
            if height_a >= height_b:
                right, b, height_b = b, a, height_a
                a = left + _GOLDEN * (right - left)
                height_a = height(a)
            else:
                left, a, height_a = a, b, height_b
                b = right - _GOLDEN * (right - left)
                height_b = height(b)
        if max(height_a, height_b) > sign * _float_of(find(point)):
            share = a if height_a >= height_b else b
            point[name] = arb(_between(lo, hi, share, lo > 0.0))
    return point


def _float_of(value: Any) -> float:
    return float(value.mid())
