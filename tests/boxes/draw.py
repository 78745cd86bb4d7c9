"""Draws boxes at the edges of what a model allows, and members of them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from flint import arb

from eskin.interval import Interval
from eskin.models.parameters import GREATEST, LEAST

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.random import Generator
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]
    Box = Mapping[str, Interval]
    Member = dict[str, arb]

SIGNED = frozenset({"time", "phase", "amplitude"})
"""Parameters of either sign."""
WITH_ZERO = frozenset(
    [
        "frequency",
        "voltage_frequency",
        "voltage",
        "inductance_change",
        "damping",
        "distance_amplitude",
    ]
)
"""Parameters that may be 0."""
ORDERED = frozenset({"inductance_change", "distance_amplitude", "base_inductance", "mean_distance"})
"""Parameters that must stay below others, or above: they keep their ordinary ranges."""
_SIZES = np.array([5e-324, 1e-310, 1e-300, 1e-60, LEAST, 1e-20, 1e-9, 1e-3, 1.0, 50.0])
_LARGE = np.array([1e5, 9.2e18, 1.9e19, 1e20, 1e30, GREATEST])
_SHARES = np.array([0.0, 0.0, 1e-15, 1e-9, 1e-3, 0.3, 1.0])


def draw(
    generator: Generator, name: str, ordinary: tuple[float, float], n: int, *, thin: bool
) -> Interval:
    """``n`` intervals of one parameter: thin, narrow, wide, from 0, over many turns.

    Args:
        generator: Draws.
        name: Of the parameter.
        ordinary: Its range in use.
        n: How many.
        thin: Whether the model needs plain numbers.
    """
    first = _values(generator, name, ordinary, n)
    if thin:
        return Interval(first)
    share = generator.choice(_SHARES, n)
    last = first + share * np.abs(first)
    other = _values(generator, name, ordinary, n)
    last = np.where(generator.random(n) < 0.3, other, last)
    most = np.inf if name in ORDERED else GREATEST
    return Interval(np.minimum(first, last), np.minimum(np.maximum(first, last), most))


def _values(generator: Generator, name: str, ordinary: tuple[float, float], n: int) -> Floats:
    low, high = ordinary if ordinary[0] > 0.0 else (1e-3, 1e3)
    usual = np.exp(generator.uniform(np.log(low), np.log(high), n))
    if name in ORDERED:
        return np.where((generator.random(n) < 0.2) & (name in WITH_ZERO), 0.0, usual)
    odd = generator.choice(np.concatenate([_SIZES, _LARGE]), n) * generator.uniform(0.5, 1.0, n)
    if name in SIGNED:
        odd *= generator.choice([-1.0, 1.0], n)
        usual *= generator.choice([-1.0, 1.0, 1.0], n)
    else:
        odd = np.where(odd < LEAST, 0.0 if name in WITH_ZERO else LEAST, odd)
    kind = generator.random(n)
    zero = 0.0 if name in WITH_ZERO | SIGNED else usual
    return np.where(kind < 0.55, usual, np.where(kind < 0.85, odd, zero))


def members(box: Box, i: int, generator: Generator, count: int) -> list[Member]:
    """Points of the ``i``-th box: half their coordinates at ends, and crests of a sine.

    Crests lie where 2·f·t is an odd number of halves, for each frequency by which time counts. They
    are quotients that no float holds, so that a point is made of `arb`.
    """
    bounds = {name: (float(v.inf[i]), float(v.sup[i])) for name, v in box.items()}
    found = []
    for _ in range(count):
        point = {}
        for name, (low, high) in bounds.items():
            share = generator.random() if generator.random() < 0.5 else float(generator.integers(2))
            inside = low + share * (high - low)
            point[name] = arb(min(max(inside, low), high))
        found.append(point)
        if "time" in bounds and generator.random() < 0.7:
            crest = _at_crest(point, bounds["time"], generator)
            if crest is not None:
                found.append(crest)
    return found


def _at_crest(point: Member, time: tuple[float, float], generator: Generator) -> Member | None:
    names = [name for name in ("frequency", "voltage_frequency") if name in point]
    if not names:
        return None
    f = point[names[int(generator.integers(len(names)))]]
    if not f > 0:
        return None
    half = arb(1) / 2
    turns = (2 * f * point["time"]).floor().mid() + half
    for shift in (0, 1, -1):
        moved = (turns + shift) / (2 * f)
        if arb(time[0]) <= moved <= arb(time[1]):
            return point | {"time": moved}
    return None
