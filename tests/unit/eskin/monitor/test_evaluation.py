from __future__ import annotations

import random
from fractions import Fraction

from hypothesis import given, settings
from hypothesis import strategies as st

from eskin.interval import Verdict
from eskin.monitor import Atom, Channel, Comparison, Constant, Formula, evaluate, is_exact
from tests.unit.eskin.monitor.formulas import bounds, formulas
from tests.unit.eskin.monitor.worlds import Sample, Truth, held, signal

PERIOD = 3
LEVELS = (-1.0, 0.0, 1.0)

ATOMS = st.builds(
    Atom,
    st.sampled_from("pq").map(Channel),
    st.sampled_from(Comparison),
    st.sampled_from((Channel("q"), Constant(0), Constant(1))),
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
    """Moments in order and values, extreme ones more often."""
    while True:
        moments = [Fraction(chance.randint(each.earliest, each.latest)) for each in samples]
        if moments == sorted(moments):
            return moments, [chance.choice((each.lo, each.hi)) for each in samples]


TIMES = [Fraction(half, 2) for half in range(-8, 50)]


@settings(max_examples=60)
@given(FORMULAS, samples(exact=False), samples(exact=False), st.integers(0, 2**32))
def test_no_truth_contradicts_a_verdict(
    formula: Formula, p: list[Sample], q: list[Sample], seed: int
) -> None:
    found = evaluate(formula, {"p": signal(p, PERIOD), "q": signal(q, PERIOD)})
    chance = random.Random(seed)  # noqa: S311 - drawn from a seed
    for _ in range(4):
        values = {}
        for name, each in (("p", p), ("q", q)):
            noise = [chance.choice((*LEVELS, 5.0, -5.0)) for _ in range(401)]
            values[name] = held(
                each, *some_world(each, chance), PERIOD, lambda t, n=noise: n[int(2 * t) % 401]
            )
        truth = Truth(values)
        for t in TIMES:
            verdict = verdict_at(found, t)
            if verdict is not Verdict.POSSIBLE:
                assert truth(formula, t) is (verdict is Verdict.CERTAIN), (str(formula), t)


def verdict_at(found: object, t: Fraction) -> Verdict:
    import numpy as np

    return Verdict(int(found._codes(np.asarray(int(2 * t)))))


@settings(max_examples=60)
@given(FORMULAS, samples(exact=True), samples(exact=True))
def test_exact_formulas_have_a_witness_of_both(
    formula: Formula, p: list[Sample], q: list[Sample]
) -> None:
    if not is_exact(formula):
        return
    signals = {"p": signal(p, PERIOD), "q": signal(q, PERIOD)}
    found = evaluate(formula, signals)
    truths = []
    for up_p in (0, 1):
        for up_q in (0, 1):
            values = {}
            for name, each, up in (("p", p, up_p), ("q", q, up_q)):
                moments = [Fraction(one.earliest) for one in each]
                ends = [one.hi if up else one.lo for one in each]
                far = 1000.0 + (name == "q" and 0)
                values[name] = held(
                    each, moments, ends, PERIOD, lambda _, f=far, u=up: f if u else -f
                )
            truths.append(Truth(values))
    for t in TIMES:
        if verdict_at(found, t) is Verdict.POSSIBLE:
            assert {truth(formula, t) for truth in truths} == {True, False}, (str(formula), t)
