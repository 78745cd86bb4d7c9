"""The worlds that agree with what is known: signals with one instant and one value a sample."""

from __future__ import annotations

from fractions import Fraction
from itertools import pairwise, product
from typing import TYPE_CHECKING, Final

from tests.unit.eskin.monitor.oracle.directions import directions, signs
from tests.unit.eskin.monitor.oracle.formulas import Number, Operation, Rational, atoms
from tests.unit.eskin.monitor.oracle.traces import Instant, Trace

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from random import Random

    from tests.unit.eskin.monitor.oracle.formulas import Expression, Formula
    from tests.unit.eskin.monitor.oracle.signals import Samples, Signals, World

FAR: Final = 10**9
"""Beyond all values that tests use."""
BESIDE: Final = Fraction(1, 2**40)
"""Less than any two values that tests use differ by."""


def constant(value: Rational) -> Trace[Rational]:
    return Trace((), (), (value,))


def extreme(formula: Formula, known: Signals, *, best: bool) -> World | None:
    """The world in which a formula holds most, or least.

    None where enclosures are uncertain, or a channel occurs in no one direction.
    """
    found = directions(formula)
    if found is None or not all(known[name].exact_instants for name in found):
        return None
    return next(level_worlds(formula, known, best=best))


def level_worlds(formula: Formula, known: Signals, *, best: bool) -> Iterator[World]:
    """Worlds of exact enclosures in which a formula may hold most, or least.

    A channel that works in one direction is far on its side. Others are everywhere as near as they
    can be to one value: far above or below, and each that decides a comparison.
    """
    found = signs(formula)
    targets: list[Rational] = [FAR]
    if 0 in found.values():
        beside = (v for n in sorted(numbers(formula)) for v in (n - BESIDE, n, n + BESIDE))
        targets += [-FAR, *beside]
    for target in targets:
        world = {}
        for name, sign in found.items():
            samples = known[name]
            aim = target if sign == 0 else FAR if (sign > 0) == best else -FAR
            heights = [min(max(aim, lo), hi) for lo, hi in zip(samples.lo, samples.hi, strict=True)]
            world[name] = samples.signal(samples.earliest, heights, constant(aim))
        yield world


def numbers(formula: Formula) -> set[Rational]:
    """All constants of a formula, and their negatives."""

    def of(expression: Expression) -> Iterator[Rational]:
        match expression:
            case Number(_, value):
                yield value
                yield -value
            case Operation(_, operands):
                for operand in operands:
                    yield from of(operand)

    return {n for atom in atoms(formula) for side in (atom.left, atom.right) for n in of(side)}


def values(samples: Samples, k: int, near: Sequence[Rational]) -> list[Rational]:
    """Ends of a sample's interval, and what lies at or just beside other values within."""
    lo, hi = samples.lo[k], samples.hi[k]
    inner = [v for n in near for v in (n - BESIDE, n, n + BESIDE) if lo < v < hi]
    return list(dict.fromkeys((lo, hi, *inner)))


def enclosures(samples: Samples, k: int, near: Sequence[Instant]) -> list[Instant]:
    """Ends of a sample's enclosures, and other instants within."""
    least, greatest = samples.enclosures[k]
    middle = Fraction(least + greatest) / 2
    within = (t for t in near if least < t < greatest)
    return list(dict.fromkeys((least, greatest, middle, *within)))


def in_order(chosen: Sequence[Instant]) -> bool:
    return all(a < b for a, b in pairwise(chosen))


def draw_world(random: Random, formula: Formula, known: Signals, instants: Sequence[int]) -> World:
    """A world from random corners."""
    near = sorted(numbers(formula))
    return {name: draw_signal(random, samples, near, instants) for name, samples in known.items()}


def every_world(formula: Formula, known: Signals, instants: Sequence[Instant]) -> Iterator[World]:
    """All corners of all channels."""
    near = sorted(numbers(formula))
    corners = [list(every_corner(samples, near, instants)) for samples in known.values()]
    for signals in product(*corners):
        yield dict(zip(known, signals, strict=True))


def every_corner(
    samples: Samples, near: Sequence[Rational], instants: Sequence[Instant]
) -> Iterator[Trace[Rational]]:
    """Signals from all corners of values and enclosures of one channel.

    Where no sample holds, the signal is far above or far below.
    """
    count = range(len(samples))
    times = [t for t in product(*(enclosures(samples, k, instants) for k in count)) if in_order(t)]
    heights = list(product(*(values(samples, k, near) for k in count)))
    for chosen, height, other in product(times, heights, (-FAR, FAR)):
        yield samples.signal(chosen, height, constant(other))


def draw_signal(
    random: Random, samples: Samples, near: Sequence[Rational], instants: Sequence[Instant]
) -> Trace[Rational]:
    """A signal from random corners; where no sample holds, it may change at any instant."""
    chosen: list[Instant] = []
    for k, (least, greatest) in enumerate(samples.enclosures):
        before = chosen[-1] if chosen else least - 1
        after = samples.enclosures[k + 1][1] if k + 1 < len(samples) else greatest + 1
        allowed = [t for t in enclosures(samples, k, instants) if before < t < after]
        middle = Fraction(max(before, least) + greatest) / 2
        chosen.append(random.choice(allowed or [middle]))
    heights = [random.choice(values(samples, k, near)) for k in range(len(samples))]
    some = [-FAR, FAR, *(v for n in near for v in (n - BESIDE, n, n + BESIDE))]
    changes = sorted(random.sample(instants, min(len(instants), random.randrange(4))))
    elsewhere = Trace(
        tuple(changes),
        tuple(random.choice(some) for _ in changes),
        tuple(random.choice(some) for _ in range(len(changes) + 1)),
    )
    return samples.signal(chosen, heights, elsewhere)
