"""The oracle itself: known examples, and the same meaning by search over a grid."""

from __future__ import annotations

from math import inf
from random import Random
from typing import TYPE_CHECKING

import pytest

from tests.unit.eskin.monitor.oracle.draw import draw_scene
from tests.unit.eskin.monitor.oracle.formulas import (
    Atom,
    Before,
    Both,
    Channel,
    Count,
    Edge,
    Formula,
    Not,
    Number,
    Rational,
    Window,
    Within,
    reach,
)
from tests.unit.eskin.monitor.oracle.intervals import value
from tests.unit.eskin.monitor.oracle.semantics import COMPARE, holds
from tests.unit.eskin.monitor.oracle.traces import Trace
from tests.unit.eskin.monitor.oracle.worlds import draw_world

if TYPE_CHECKING:
    from tests.unit.eskin.monitor.oracle.signals import World

SCENES = 400
P = Atom(Channel("p"), ">", Number("0", 0))
Q = Atom(Channel("q"), ">", Number("0", 0))


def pulse(begin: int, end: int) -> Trace[Rational]:
    """1 from ``begin`` until before ``end``, 0 elsewhere."""
    return Trace((begin, end), (1, 0), (0, 1, 0))


def window(begin: int, end: float) -> Window:
    return Window(begin, end, f"[{begin}ns,{end}ns]")


@pytest.mark.parametrize(
    ("formula", "true", "false"),
    [
        (Within("always", window(0, 10), P), [10, 19], [9, 20]),
        (Within("always", window(2, 4), P), [8, 25], [7, 26]),
        (Within("eventually", window(2, 4), P), [6, 27], [5, 28]),
        (Within("historically", window(2, 4), P), [14, 31], [13, 32]),
        (Within("once", window(2, 4), P), [12, 33], [11, 34]),
        (Within("eventually", window(2, inf), P), [-(10**9), 27], [28]),
        (Within("historically", window(5, inf), Not(P)), [14], [15, 10**9]),
        (Edge("rise", P), [10], [9, 11, 30]),
        (Count((P, Q, P), ">=", 2), [10, 29], [9, 30, 39]),
        (Edge("fall", P), [30], [29, 31, 10]),
        # q from 30 on: p need not hold at 30 itself.
        (Before("until", window(0, 5), P, Q), [25, 29, 30, 39], [24, 9, 40]),
        # p must hold in [t, t'), here to the end of p.
        (Before("until", window(5, 5), P, Q), [25], [24, 26]),
        # q must hold in (t', t], so also in what is left of p's time: here it does not.
        (Before("since", window(0, 5), Q, P), [10, 29], [9, 30, 34]),
        (Before("since", window(1, 5), P, P), [11, 29], [10, 30]),
    ],
)
def test_examples(formula: Formula, true: list[int], false: list[int]) -> None:
    found = holds(formula, {"p": pulse(10, 30), "q": pulse(30, 40)})
    assert [found(t) for t in true] == [True] * len(true)
    assert [found(t) for t in false] == [False] * len(false)


def holds_at(formula: Formula, world: World, t: int, half: int) -> bool:
    """The meaning at an instant, by search over a grid.

    Everything changes at whole steps of the grid only; halves of them stand for what lies between.
    """

    def within(begin: float, end: float) -> range:
        return range(int(begin), int(end) + 1, half)

    match formula:
        case Atom(left, comparison, right):
            point = {name: signal(t) for name, signal in world.items()}
            return bool(COMPARE[comparison](value(left, point), value(right, point)))
        case Not(operand):
            return not holds_at(operand, world, t, half)
        case Both(name, left, right):
            a, b = (holds_at(each, world, t, half) for each in (left, right))
            return {"and": a and b, "or": a or b, "implies": not a or b}[name]
        case Within(name, span, operand):
            past = name in {"historically", "once"}
            begin, end = (-span.end, -span.begin) if past else (span.begin, span.end)
            found = (holds_at(operand, world, u, half) for u in within(t + begin, t + end))
            return all(found) if name in {"always", "historically"} else any(found)
        case Before(name, span, left, right):
            sign = 1 if name == "until" else -1

            def up_to(delay: int) -> range:
                # Part of what a half stands for lies before it.
                is_half = (t + sign * delay) % (2 * half) != 0
                return range(0, delay + (is_half and delay > 0), half)

            return any(
                holds_at(right, world, t + sign * delay, half)
                and all(holds_at(left, world, t + sign * d, half) for d in up_to(delay))
                for delay in within(span.begin, span.end)
            )
        case Edge(name, operand):
            if t % (2 * half):
                return False
            now, earlier = (holds_at(operand, world, u, half) for u in (t, t - half))
            return (now and not earlier) if name == "rise" else (earlier and not now)
        case Count(operands, comparison, number):
            held = sum(holds_at(each, world, t, half) for each in operands)
            return bool(COMPARE[comparison](held, number))


def test_meaning_is_that_of_a_search_over_a_grid() -> None:
    both = 0
    for seed in range(SCENES):
        random = Random(seed)
        scene = draw_scene(random, depth=2, samples=4)
        if inf in reach(scene.formula):
            continue  # no grid is so long
        whole = [t for t in scene.instants if t % scene.step == 0]
        world = draw_world(random, scene.formula, scene.known, whole)
        found = holds(scene.formula, world)
        half = scene.step // 2
        for t in range(whole[0], whole[0] + 40 * half, half):
            assert found(t) == holds_at(scene.formula, world, t, half), (seed, t)
        both += len(found.at) > 0
    assert both > SCENES / 3
