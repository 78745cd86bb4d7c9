"""Random formulas, and random knowledge of their channels.

Times lie on a coarse grid and values on few numbers, so that ends of windows meet those of
enclosures, and bounds meet thresholds.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from typing import TYPE_CHECKING, Final

from tests.unit.eskin.monitor.oracle.directions import directions
from tests.unit.eskin.monitor.oracle.formulas import (
    Atom,
    Before,
    Both,
    Channel,
    Comparison,
    Count,
    Edge,
    Expression,
    Formula,
    Not,
    Number,
    Operation,
    Rational,
    Window,
    Windowed,
    Within,
    channels,
)
from tests.unit.eskin.monitor.oracle.signals import Samples, Signals

if TYPE_CHECKING:
    from random import Random

NAMES: Final = ("t01.pressure", "t02.pressure")
UNIT: Final = "Pa"
COMPARISONS: Final[tuple[Comparison, ...]] = ("<", "<=", ">", ">=")
WINDOWS: Final[tuple[Windowed, ...]] = ("always", "eventually", "historically", "once")
UNITS: Final = (("ns", 1), ("us", 10**3), ("ms", 10**6), ("s", 10**9))
GRID: Final = 4
"""Steps of the grid in a unit of time, so that each half of a step is whole nanoseconds."""


@dataclass(frozen=True)
class Scene:
    """A formula, and what is known of its channels.

    Attributes:
        step: The time grid's, in nanoseconds.
    """

    formula: Formula
    known: Signals
    step: int

    @cached_property
    def instants(self) -> list[int]:
        """Ends of enclosures and holds, what is beside them, and what lies far off."""
        ends = {t for samples in self.known.values() for pair in samples.enclosures for t in pair}
        ends |= {s.until for s in self.known.values() if s.until is not None}
        ends |= {t + samples.period for samples in self.known.values() for t in ends}
        near = {t + shift for t in ends or {0} for shift in (-self.step, -1, 0, 1, self.step)}
        return sorted(near | {min(near) - 20 * self.step, max(near) + 20 * self.step})


def draw_scene(random: Random, *, depth: int = 3, samples: int = 8) -> Scene:
    """A formula of at most so many nested operators over channels of at most so many samples."""
    text, unit = random.choice(UNITS)
    step = GRID * unit
    times = _Times(random, text, step)
    depth = random.randint(1, depth)
    names = NAMES[: 1 + (random.random() < 0.4)]
    formula = _draw_formula(random, times, names, depth)
    exact_instants = random.random() < 0.6
    if exact_instants and random.random() < 0.7:
        while directions(formula) is None:
            formula = _draw_formula(random, times, names, depth)
    counts = (*range(samples + 1), *range(samples // 2, samples + 1))
    known = {
        name: draw_samples(random, random.choice(counts), step, exact=exact_instants)
        for name in sorted(set(channels(formula)))
    }
    return Scene(formula, known, step)


def draw_samples(random: Random, count: int, step: int, *, exact: bool) -> Samples:
    """Samples of a channel, with exact enclosures or with some uncertain ones."""
    now = random.randint(-2, 2)
    kilo = random.random() < 0.3
    earliest, latest, lo, hi = [], [], [], []
    for _ in range(count):
        now += random.randint(1, 4)
        earlier, later = (0, 0) if exact else (random.choice((0, 0, 1, 2, 5)) for _ in range(2))
        earliest.append((now - earlier) * step)
        latest.append((now + later) * step)
        low, high = _draw_bounds(random, 1000 if kilo else 1)
        lo.append(low)
        hi.append(high)
    gap = tuple(random.random() < 0.12 for _ in range(count))
    # Any enclosures can ascend.
    latest = [max(b, *(t + step for t in earliest[:k]), earliest[k]) for k, b in enumerate(latest)]
    return Samples(
        tuple(earliest),
        tuple(latest),
        tuple(lo),
        tuple(hi),
        random.randint(1, 4) * step,
        gap,
        (now + random.randint(-2, 4)) * step if random.random() < 0.3 else None,
        kilo,
    )


def exact(number: float) -> Rational:
    """The number itself, as an integer where it is one, which Python compares faster."""
    return int(number) if number.is_integer() else Fraction(number)


def _draw_bounds(random: Random, factor: int) -> tuple[Rational, Rational]:
    """Bounds that are floats after a division by a factor."""
    whole = random.randint(-2, 5)
    low = whole / factor
    high = (whole + random.choice((0, 0, 1, 2, 4))) / factor
    if random.random() < 0.1:
        low = math.nextafter(low, -math.inf)
    if random.random() < 0.1:
        high = math.nextafter(high, math.inf)
    return exact(low) * factor, exact(high) * factor


@dataclass(frozen=True)
class _Times:
    random: Random
    unit: str
    step: int

    def window(self) -> Window:
        begin = self.random.choice((0, 0, 0, 1, 2, 3))
        end = begin + self.random.choice((0, 1, 1, 2, 3, 6))
        left = "0" if not begin and self.random.random() < 0.5 else f"{begin * GRID}{self.unit}"
        if self.random.random() < 0.05:
            both = begin == 0 and self.random.random() < 0.5
            text = "" if both else f"[{begin * GRID}{self.unit},inf)"
            return Window(begin * self.step, math.inf, text)
        return Window(begin * self.step, end * self.step, f"[{left},{end * GRID}{self.unit}]")


def _draw_formula(random: Random, times: _Times, names: tuple[str, ...], depth: int) -> Formula:
    if depth == 0 or random.random() < 0.1:
        return _draw_atom(random, names)

    def inner() -> Formula:
        return _draw_formula(random, times, names, depth - 1)

    kind = random.randrange(21)
    if kind < 2:
        return Not(inner())
    if kind < 7:
        return Both(random.choice(("and", "or", "implies")), inner(), inner())
    if kind < 14:
        return Within(random.choice(WINDOWS), times.window(), inner())
    if kind < 19:
        return Before(random.choice(("until", "since")), times.window(), inner(), inner())
    if kind < 20:
        return Edge(random.choice(("rise", "fall")), inner())
    operands = tuple(inner() for _ in range(random.randint(1, 3)))
    return Count(operands, random.choice(COMPARISONS), random.randint(0, 3))


def _draw_atom(random: Random, names: tuple[str, ...]) -> Atom:
    left = _draw_expression(random, names)
    right: Expression = _draw_number(random)
    if random.random() < 0.1:
        right = Channel(random.choice(names))
    if random.random() < 0.2:
        left, right = right, left
    return Atom(left, random.choice(COMPARISONS), right)


def _draw_expression(random: Random, names: tuple[str, ...]) -> Expression:
    one = Channel(random.choice(names))
    if random.random() < 0.75:
        return one
    other: Expression = (
        Channel(random.choice(names)) if random.random() < 0.7 else _draw_number(random)
    )
    match random.randrange(6):
        case 0:
            return Operation(random.choice(("+", "-")), (one, other))
        case 1:
            return Operation(random.choice(("min", "max")), (one, other))
        case 2:
            return Operation("neg", (one,))
        case 3:
            return Operation("abs", (one,))
        case 4:
            factor = random.choice((-2, -1, 2, 3))
            return Operation("*", (Number(str(factor), factor), one))
        case _:
            return Operation("/", (one, Number("2", 2)))


def _draw_number(random: Random) -> Number:
    whole = random.randint(-1, 5)
    text, factor = random.choice((("Pa", 1), ("kPa", 1000)))
    return Number(f"{whole / factor} {text}", whole)
