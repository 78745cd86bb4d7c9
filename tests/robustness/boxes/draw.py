"""Boxes of awkward parameters: zero, subnormal, huge, negative where allowed, thin and wide."""

from __future__ import annotations

import enum
from typing import TYPE_CHECKING, Final

import numpy as np

from eskin.interval import Interval

if TYPE_CHECKING:
    from numpy.random import Generator
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]

LEAST: Final = 1e-40
GREATEST: Final = 1e40
_TINY: Final = (5e-324, 1e-310, 2.2250738585072014e-308, 1e-300, 1e-160, 1e-40)
_RELATIVE_WIDTHS: Final = (0.0, 0.0, 2.0**-52, 1e-9, 1e-3, 0.1, 0.5)


class Kind(enum.Enum):
    """Which values a parameter may take."""

    POSITIVE = "positive"
    NOT_NEGATIVE = "not negative"
    FINITE = "finite"


def draw(
    generator: Generator,
    kind: Kind,
    typical: tuple[float, float],
    n: int,
    *,
    thin: bool = False,
    extent: tuple[float, float] = (LEAST, GREATEST),
) -> Interval:
    """Draw intervals of one parameter: half of them near what the paper has.

    Args:
        generator: Draws.
        kind: Which values are allowed.
        typical: Least and greatest size of an ordinary value.
        n: How many.
        thin: Whether only single numbers are allowed.
        extent: Least and greatest size of a value that is not zero.
    """
    middle = _values(generator, kind, typical, n, extent)
    if thin:
        return Interval(middle)
    width = np.abs(middle) * generator.choice(_RELATIVE_WIDTHS, n)
    other = middle + width * generator.choice([-1.0, 1.0], n)
    far = generator.random(n) < 0.1  # two values that have nothing to do with each other
    other = np.where(far, _values(generator, kind, typical, n, extent), other)
    other = _allowed(other, kind, extent)
    return Interval(np.minimum(middle, other), np.maximum(middle, other))


def _values(
    generator: Generator,
    kind: Kind,
    typical: tuple[float, float],
    n: int,
    extent: tuple[float, float],
) -> Floats:
    ordinary = np.exp(generator.uniform(np.log(typical[0]), np.log(typical[1]), n))
    anywhere = np.exp(generator.uniform(np.log(extent[0]), np.log(extent[1]), n))
    ends = generator.choice(extent, n)
    special = generator.choice([*_TINY, 0.0] if kind is Kind.FINITE else [0.0], n)
    if kind is Kind.POSITIVE:
        special = ends
    kinds = np.stack([ordinary, anywhere, ends, special])
    share = generator.choice(4, n, p=[0.55, 0.25, 0.03, 0.17])
    value = kinds[share, np.arange(n)]
    if kind is Kind.FINITE:
        value *= generator.choice([-1.0, 1.0], n)
    return _allowed(value, kind, extent)


def _allowed(value: Floats, kind: Kind, extent: tuple[float, float]) -> Floats:
    if kind is Kind.FINITE:
        return np.clip(value, -extent[1], extent[1])
    inside = np.clip(value, *extent)
    return np.where(value <= 0.0, 0.0, inside) if kind is Kind.NOT_NEGATIVE else inside
