"""Holds a model's results against its formula at members of random boxes."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from flint import arb, ctx

from tests.robustness.boxes import points
from tests.robustness.boxes.cases import CASES

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from numpy.random import Generator

    from eskin.interval import Interval
    from tests.robustness.boxes.cases import Case

_BITS: Final = (420, 1700, 7000)
"""Until the answer is certain: angles of 1e80, and differences that cancel at times of 1e-320."""
_BATCH: Final = 250
_SEARCHED: Final = 0.15
"""Share of the boxes of a hard model in which inner optima are searched for."""
_SHOWN: Final = 3


@dataclass
class Outcome:
    """What came out for one model.

    Attributes:
        name: Of the model.
        boxes: How many were drawn.
        points: How many members were compared.
        violations: How many boxes were wrong.
        excess: The farthest that a value lay outside, relative to it.
        examples: Boxes that were wrong.
    """

    name: str
    boxes: int = 0
    points: int = 0
    violations: int = 0
    excess: float = 0.0
    examples: list[str] = field(default_factory=list)


def verify(name: str, count: int, seed: int) -> Outcome:
    """Draw boxes for one model, and compare."""
    before = ctx.prec
    try:
        return _verify(name, count, seed)
    finally:
        ctx.prec = before


def _verify(name: str, count: int, seed: int) -> Outcome:
    case, outcome = CASES[name], Outcome(name)
    generator = np.random.default_rng([seed, sorted(CASES).index(name)])
    while outcome.boxes < count:
        n = min(_BATCH, count - outcome.boxes)
        compare(case, case.boxes(generator, n), generator, outcome)
    return outcome


def compare(
    case: Case, box: Mapping[str, Interval], generator: Generator, outcome: Outcome
) -> None:
    """Evaluate boxes and hold the results against their members."""
    found = case.evaluate(box)
    n = next(iter(box.values())).inf.size
    for i in range(n):
        sides = {k: (float(v.inf[i]), float(v.sup[i])) for k, v in box.items()}
        bounds = {k: (float(v.inf[i]), float(v.sup[i])) for k, v in found.items()}
        worst, stated = _judge(case, sides, bounds, generator, outcome)
        outcome.boxes += 1
        if stated:
            outcome.violations += 1
            outcome.excess = max(outcome.excess, worst)
            if len(outcome.examples) < _SHOWN:
                outcome.examples.append(f"{stated}\n    of {sides}")


def _judge(
    case: Case,
    sides: Mapping[str, tuple[float, float]],
    bounds: Mapping[str, tuple[float, float]],
    generator: Generator,
    outcome: Outcome,
) -> tuple[float, str]:
    for name, (inf, sup) in bounds.items():
        if not inf <= sup:
            return math.inf, f"{name} is [{inf!r}, {sup!r}]"
    ctx.prec = _BITS[0]
    worst, stated = 0.0, ""
    for point in _members(case, sides, generator):
        outcome.points += 1
        for name, excess in _excesses(case, point, bounds):
            if excess > worst:
                at = {k: float(v.mid()) for k, v in point.items()}
                worst, stated = excess, f"{name} {bounds[name]} misses by {excess:.3g} at {at}"
    return worst, stated


def _members(
    case: Case, sides: Mapping[str, tuple[float, float]], generator: Generator
) -> Iterator[dict[str, Any]]:
    if all(lo == hi for lo, hi in sides.values()):
        yield points.corner(sides, generator)
        return
    for _ in range(5):
        yield points.corner(sides, generator)
    for _ in range(5):
        yield points.inside(sides, generator)
    if {"time", "frequency"} <= sides.keys():
        yield from points.crests(sides, generator)
    if "phase" in sides and sides.get("amplitude") != (0.0, 0.0):
        yield from points.phases(sides, generator, lambda p: case.formula(p)["value"])
    if case.hard and generator.random() < _SEARCHED:
        yield from _optima(case, sides, generator)


def _optima(
    case: Case, sides: Mapping[str, tuple[float, float]], generator: Generator
) -> Iterator[dict[str, Any]]:
    """Where a search from an inner point ends, up and down for each result."""
    start = points.inside(sides, generator)
    for name in case.formula(start):

        def find(p: dict[str, Any], name: str = name) -> Any:
            return case.formula(p)[name]

        for sign in (1.0, -1.0):
            yield points.climb(sides, start, find, sign)


def _excesses(
    case: Case, point: Mapping[str, Any], bounds: Mapping[str, tuple[float, float]]
) -> Iterator[tuple[str, float]]:
    """Results that certainly lie outside at a point, and how far."""
    values = case.formula(point)
    for name, (inf, sup) in bounds.items():
        value = values[name]
        for bits in _BITS[1:]:
            if (value >= arb(inf) or value < arb(inf)) and (value <= arb(sup) or value > arb(sup)):
                break
            ctx.prec = bits
            value = case.formula(point)[name]
        ctx.prec = _BITS[0]
        if value < arb(inf) or value > arb(sup):
            beyond = float((arb(inf) - value).mid()) if value < arb(inf) else 0.0
            beyond = max(beyond, float((value - arb(sup)).mid()))
            yield name, max(beyond / max(abs(float(value.mid())), 5e-324), 5e-324)
