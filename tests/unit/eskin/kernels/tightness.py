"""How far bounds are from the tightest ones, over stated distributions of arguments (python-flint).

Arguments are single numbers, as intervals: then both bounds stand beside the exact result.
"""

from __future__ import annotations

import math
import operator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, TypeAlias

import flint
import numpy as np

from eskin.interval import Interval

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    Floats = NDArray[np.float64]
    Draw = Callable[[np.random.Generator, int], tuple[Floats, ...]]

Exact: TypeAlias = Any
"""A `flint.arb`."""
BITS: Final = 300
EXACT_BITS: Final = 4400
"""Any ``a·b + c`` of floats is exact in these."""
MOST: Final = 8
"""Floats beyond which the distance is not counted."""
UNSOUND: Final = -1


@dataclass(frozen=True)
class Case:
    """An operation and what it is given.

    Attributes:
        name: The operation.
        arguments: The distribution of its arguments, in words.
        draw: Draws them.
        ours: The operation on intervals.
        exact: The same on numbers of many bits.
        bits: How many.
    """

    name: str
    arguments: str
    draw: Draw
    ours: Callable[..., Interval]
    exact: Callable[..., Exact]
    bits: int = BITS

    def distances(self, count: int, seed: int) -> NDArray[np.int64]:
        """For each result its bounds' distances from the tightest ones, in floats.

        A bound on the wrong side of the exact result has the distance `UNSOUND`.
        """
        given = self.draw(np.random.default_rng(seed), count)
        result = self.ours(*map(Interval, given))
        columns = [each.tolist() for each in given]
        before = flint.ctx.prec
        flint.ctx.prec = self.bits
        try:
            found = [
                (_distance(lo, truth, np.inf), _distance(hi, truth, -np.inf))
                for lo, hi, truth in zip(
                    result.inf.tolist(),
                    result.sup.tolist(),
                    (self.exact(*map(flint.arb, point)) for point in zip(*columns, strict=True)),
                    strict=True,
                )
            ]
        finally:
            flint.ctx.prec = before
        return np.array(found, dtype=np.int64)


def _distance(bound: float, truth: Exact, inward: float) -> int:
    """How many floats lie between a bound and the exact result, which is ``inward`` of it."""

    def is_outside(x: float) -> bool:
        return bool(flint.arb(x) <= truth if inward > 0.0 else flint.arb(x) >= truth)

    if not is_outside(bound):
        return UNSOUND
    for distance in range(MOST):
        bound = math.nextafter(bound, inward)
        if not is_outside(bound):
            return distance
    return MOST


def _fma(x: Exact, y: Exact, z: Exact) -> Exact:
    return x * y + z


def _signed(rng: np.random.Generator, count: int, least: float, most: float) -> Floats:
    """Numbers of either sign, uniform in the logarithm of their size."""
    return np.asarray(rng.choice((-1.0, 1.0), count) * 10.0 ** rng.uniform(least, most, count))


def _sizes(*decades: tuple[float, float]) -> Draw:
    return lambda rng, count: tuple(_signed(rng, count, *each) for each in decades)


def _positive(least: float, most: float) -> Draw:
    return lambda rng, count: (10.0 ** rng.uniform(least, most, count),)


def _uniform(least: float, most: float) -> Draw:
    return lambda rng, count: (rng.uniform(least, most, count),)


def _any(operands: int) -> Draw:
    """Finite floats, uniform in their bits."""

    def draw(rng: np.random.Generator, count: int) -> tuple[Floats, ...]:
        bits = rng.integers(0, 0x7FF0000000000000, (operands, count))
        return tuple(rng.choice((-1.0, 1.0), (operands, count)) * bits.view(np.float64))

    return draw


def _factors(rng: np.random.Generator, count: int) -> tuple[Floats, Floats]:
    """Two numbers with a product of size 1e-325 to 1e-289."""
    product, first = rng.uniform(-325.0, -289.0, count), rng.uniform(-250.0, -40.0, count)
    signs = rng.choice((-1.0, 1.0), (2, count))
    return signs[0] * 10.0**first, signs[1] * 10.0 ** (product - first)


def _cancelling(rng: np.random.Generator, count: int) -> tuple[Floats, ...]:
    """A product, and what leaves a few units in its last place of it."""
    a, b = _signed(rng, count, -3.0, 3.0), _signed(rng, count, -3.0, 3.0)
    return a, b, -a * b * (1.0 + rng.integers(-4, 5, count) * 2.0**-52)


def _cancelling_small(rng: np.random.Generator, count: int) -> tuple[Floats, ...]:
    a, b = _factors(rng, count)
    return a, b, -a * b + rng.integers(-4, 5, count) * 5e-324


def _small_beside_any(rng: np.random.Generator, count: int) -> tuple[Floats, ...]:
    return *_factors(rng, count), _signed(rng, count, -323.0, 300.0)


def _cancelling_large(rng: np.random.Generator, count: int) -> tuple[Floats, ...]:
    """A product beside the greatest float, or beyond it, and what leaves less of it."""
    first, product = rng.uniform(100.0, 200.0, count), rng.uniform(307.9, 308.5, count)
    signs = rng.choice((-1.0, 1.0), (2, count))
    term = -signs[0] * signs[1] * rng.uniform(0.1, 1.7, count) * 1e308
    return signs[0] * 10.0**first, signs[1] * 10.0 ** (product - first), term


_THOUSANDS: Final = (-3.0, 3.0)
_PLAIN: Final = "size 1e-3 to 1e3"
_ANY: Final = "any floats"
_FAR: Final = "size 2.5e14 to 1e308"
_SMALL: Final = "results below 1e-289"
CASES: Final = (
    Case("add", _PLAIN, _sizes(_THOUSANDS, _THOUSANDS), operator.add, operator.add),
    Case("add", _ANY, _any(2), operator.add, operator.add, EXACT_BITS),
    Case("mul", _PLAIN, _sizes(_THOUSANDS, _THOUSANDS), operator.mul, operator.mul),
    Case("mul", _SMALL, _factors, operator.mul, operator.mul),
    Case("mul", _ANY, _any(2), operator.mul, operator.mul),
    Case("sqr", _PLAIN, _sizes(_THOUSANDS), Interval.sqr, lambda x: x * x),
    Case("sqr", _SMALL, _positive(-162.0, -144.5), Interval.sqr, lambda x: x * x),
    Case("div", _PLAIN, _sizes(_THOUSANDS, _THOUSANDS), operator.truediv, operator.truediv),
    Case(
        "div", _SMALL, _sizes((-308.0, -269.0), (-20.0, 16.0)), operator.truediv, operator.truediv
    ),
    Case("div", _ANY, _any(2), operator.truediv, operator.truediv),
    Case("sqrt", _PLAIN, _positive(*_THOUSANDS), Interval.sqrt, flint.arb.sqrt),
    Case("sqrt", "below 1e-289", _positive(-323.0, -289.0), Interval.sqrt, flint.arb.sqrt),
    Case("fma", _PLAIN, _sizes(*[_THOUSANDS] * 3), Interval.fma, _fma, EXACT_BITS),
    Case("fma", "cancelling", _cancelling, Interval.fma, _fma, EXACT_BITS),
    Case("fma", "cancelling below 1e-289", _cancelling_small, Interval.fma, _fma, EXACT_BITS),
    Case("fma", "cancelling beside 1.8e308", _cancelling_large, Interval.fma, _fma, EXACT_BITS),
    Case("fma", "product below 1e-289", _small_beside_any, Interval.fma, _fma, EXACT_BITS),
    Case("fma", _ANY, _any(3), Interval.fma, _fma, EXACT_BITS),
    Case("exp", "-1 to 1", _uniform(-1.0, 1.0), Interval.exp, flint.arb.exp),
    Case("exp", "-708 to 709", _uniform(-708.0, 709.0), Interval.exp, flint.arb.exp),
    Case("exp", "subnormal results", _uniform(-745.0, -708.5), Interval.exp, flint.arb.exp),
    Case("log", _ANY, _positive(-307.0, 308.0), Interval.log, flint.arb.log),
    Case("sin", "-10 to 10", _uniform(-10.0, 10.0), Interval.sin, flint.arb.sin),
    Case("tan", "-10 to 10", _uniform(-10.0, 10.0), Interval.tan, flint.arb.tan),
    Case("sin", _FAR, _sizes((14.4, 308.0)), Interval.sin, flint.arb.sin, EXACT_BITS),
    Case("cos", _FAR, _sizes((14.4, 308.0)), Interval.cos, flint.arb.cos, EXACT_BITS),
    Case("tan", _FAR, _sizes((14.4, 308.0)), Interval.tan, flint.arb.tan, EXACT_BITS),
    Case("tanh", "-10 to 10", _uniform(-10.0, 10.0), Interval.tanh, flint.arb.tanh),
)
