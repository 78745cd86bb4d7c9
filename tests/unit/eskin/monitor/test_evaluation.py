from __future__ import annotations

import random
from fractions import Fraction
from itertools import product
from typing import TYPE_CHECKING

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from eskin.interval import Verdict
from eskin.monitor import Atom, Channel, Comparison, Constant, Formula, Verdicts, evaluate, is_exact
from tests.unit.eskin.monitor.formulas import bounds, formulas
from tests.unit.eskin.monitor.worlds import Sample, Truth, held, signal

if TYPE_CHECKING:
    from collections.abc import Callable

PERIOD = 3
LEVELS = (-1.0, 0.0, 1.0)

ATOMS = st.builds(
    Atom,
    st.sampled_from((Channel("p"), Channel("q"), Channel("p", 3))),
    st.sampled_from(Comparison),
    st.sampled_from((Channel("q"), Channel("p", 2), Constant(0), Constant(1))),
)
FORMULAS = formulas(ATOMS, bounds(4, unbounded=False), max_leaves=4)


@st.composite
def samples(draw: st.DrawFn, *, exact: bool) -> list[Sample]:
    made, t = [], 0
    for _ in range(draw(st.integers(0, 4))):
        t += draw(st.integers(1, 5))
        spread = 0 if exact else draw(st.integers(0, 4))
        lo, hi = sorted((draw(st.sampled_from(LEVELS)), draw(st.sampled_from(LEVELS))))
        made.append(Sample(t, t + spread, lo, hi, draw(st.booleans())))
    return made


def some_world(samples: list[Sample], chance: random.Random) -> tuple[list[Fraction], list[float]]:
    """Instants in order and values, extreme ones more often."""
    while True:
        instants = [Fraction(chance.randint(each.earliest, each.latest)) for each in samples]
        if instants == sorted(instants):
            return instants, [chance.choice((each.lo, each.hi)) for each in samples]


TIMES = [Fraction(half, 2) for half in range(-8, 50)]


def any_value(chance: random.Random) -> Callable[[Fraction], float]:
    """What an unknown signal may do: anything, anew at each tick."""
    noise = [chance.choice((*LEVELS, 5.0, -5.0)) for _ in range(401)]
    return lambda t: noise[int(2 * t) % 401]


def always(value: float) -> Callable[[Fraction], float]:
    return lambda _: value


@settings(max_examples=60)
@given(FORMULAS, samples(exact=False), samples(exact=False), st.integers(0, 2**32))
def test_no_truth_contradicts_a_verdict(
    formula: Formula, p: list[Sample], q: list[Sample], seed: int
) -> None:
    found = evaluate(formula, {"p": signal(p, PERIOD), "q": signal(q, PERIOD)})
    chance = random.Random(seed)  # noqa: S311 - drawn from a seed
    for _ in range(4):
        worlds = {name: some_world(each, chance) for name, each in (("p", p), ("q", q))}
        truth = Truth(
            {
                name: held(each, *worlds[name], PERIOD, any_value(chance))
                for name, each in (("p", p), ("q", q))
            }
        )
        for t in TIMES:
            verdict = verdict_at(found, t)
            if verdict is not Verdict.POSSIBLE:
                assert truth(formula, t) is (verdict is Verdict.CERTAIN), (str(formula), t)


def verdict_at(found: Verdicts, t: Fraction) -> Verdict:
    return Verdict(int(found.codes_at_ticks(np.asarray(int(2 * t)))))


@settings(max_examples=60)
@given(FORMULAS.filter(is_exact), samples(exact=True), samples(exact=True))
def test_exact_formulas_have_a_witness_of_both(
    formula: Formula, p: list[Sample], q: list[Sample]
) -> None:
    found = evaluate(formula, {"p": signal(p, PERIOD), "q": signal(q, PERIOD)})
    truths = []
    for upward in product((False, True), repeat=2):
        values = {}
        for (name, each), up in zip((("p", p), ("q", q)), upward, strict=True):
            instants = [Fraction(one.earliest) for one in each]
            ends = [one.hi if up else one.lo for one in each]
            values[name] = held(each, instants, ends, PERIOD, always(1e3 if up else -1e3))
        truths.append(Truth(values))
    for t in TIMES:
        if verdict_at(found, t) is Verdict.POSSIBLE:
            assert {truth(formula, t) for truth in truths} == {True, False}, (str(formula), t)
