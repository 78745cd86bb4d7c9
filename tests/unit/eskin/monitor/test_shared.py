"""Errors that samples share: verdicts stay true, and are more often decided."""

from __future__ import annotations

import random
from dataclasses import dataclass
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from eskin.errors import MonitorError
from eskin.interval import Interval, Verdict
from eskin.monitor import Monitor, SharedError, Signal, evaluate, parse
from tests.unit.eskin.monitor.test_online import codes_of
from tests.unit.eskin.monitor.worlds import Truth

PERIOD = 3
ALPHA = 2.0, 2.5
BETA = -0.25, 0.5
NAME = "sheet"
COUNT = 6
FORMULAS = (
    "p - delay(p, 3ns) > {c}",
    "delay(p, 4ns) - p >= {c}",
    "abs(p - delay(p, 3ns)) < {c}",
    "p - q > {c}",
    "p < q - {c}",
    "2 * p - q - delay(q, 2ns) > {c}",
    "p / 2 - (delay(p, 3ns) + q) / 4 <= {c}",
    "max(p - delay(p, 3ns), q - delay(q, 6ns)) > {c}",
    "p + q - 2 * delay(p, 3ns) > {c} and once[0,6ns] p - q > {c}",
    "p - delay(p, 3ns) > q",
)


@dataclass
class World:
    """Bounds of samples, their epochs, and true values that they allow."""

    lo: np.ndarray
    hi: np.ndarray
    epoch: np.ndarray
    truth: list[Fraction]


def some(chance: random.Random, lo: float, hi: float) -> Fraction:
    """A number between, often an end."""
    share = chance.choice((Fraction(0), Fraction(1), Fraction(chance.randint(0, 64), 64)))
    return Fraction(lo) + share * (Fraction(hi) - Fraction(lo))


def draw(
    chance: random.Random,
    errors: dict[int, tuple[Fraction, Fraction]],
    beta: tuple[float, float],
    epochs: tuple[int, ...],
) -> World:
    lo, hi, drawn, truth = [], [], [], []
    for _ in range(COUNT):
        least = chance.randint(-32, 32) / 8
        most = least + chance.randint(0, 2) / 16
        epoch = chance.choice(epochs)
        ends = [
            Fraction(a) * (Fraction(u) + Fraction(b))
            for a in ALPHA
            for b in beta
            for u in (least, most)
        ]
        alpha, shift = errors[epoch] if epoch else (some(chance, *ALPHA), some(chance, *beta))
        truth.append(alpha * (some(chance, least, most) + shift))
        bounds = Interval(float(min(ends)), float(max(ends)))  # exact: small binary fractions
        lo.append(float(bounds.inf) - chance.choice((0.0, 2.0**-10)))
        hi.append(float(bounds.sup) + chance.choice((0.0, 2.0**-10)))
        drawn.append(epoch)
    return World(np.array(lo), np.array(hi), np.array(drawn), truth)


def scene(
    seed: int, beta: tuple[float, float] = BETA, *, epochs: tuple[int, ...] = (1, 1, 1, 2, 0)
) -> dict[str, World]:
    """Worlds of p and q, which share one error."""
    chance = random.Random(seed)  # noqa: S311 - drawn from a seed
    errors = {epoch: (some(chance, *ALPHA), some(chance, *beta)) for epoch in (1, 2)}
    return {name: draw(chance, errors, beta, epochs) for name in "pq"}


INSTANTS = np.arange(COUNT) * PERIOD


def signal(world: World, beta: tuple[float, float] = BETA, *, shared: bool = True) -> Signal:
    error = SharedError(ALPHA, beta, world.epoch, NAME) if shared else None
    return Signal(INSTANTS, INSTANTS, world.lo, world.hi, PERIOD, until=100, shared=error)


@settings(max_examples=300)
@given(st.sampled_from(FORMULAS), st.integers(-40, 40), st.integers(0, 2**32), st.booleans())
def test_no_truth_contradicts_a_verdict(text: str, eighths: int, seed: int, zero: bool) -> None:  # noqa: FBT001 - drawn
    beta = (0.0, 0.0) if zero else BETA
    worlds = scene(seed, beta)
    formula = parse(text.format(c=eighths / 8))
    found = evaluate(formula, {name: signal(each, beta) for name, each in worlds.items()})

    def value(name: str) -> object:
        return lambda t: worlds[name].truth[min(int(t // PERIOD), COUNT - 1)]

    truth = Truth({name: value(name) for name in worlds})  # type: ignore[misc]  # fractions
    for t in range(2 * PERIOD, COUNT * PERIOD):
        verdict = found.at(t)
        if verdict is not Verdict.POSSIBLE:
            assert truth(formula, Fraction(t)) is (verdict is Verdict.CERTAIN), t
        robustness = found.robustness(t)
        assert (robustness.inf > 0.0) <= (verdict is Verdict.CERTAIN)
        assert (robustness.sup < 0.0) <= (verdict is Verdict.IMPOSSIBLE)


SUMS: dict[str, tuple[Fraction | int, ...]] = {
    "p - delay(p, 3ns) > {c}": (1, -1, 0),
    "p + q - delay(p, 3ns) > {c}": (1, -1, 1),
    "p + delay(p, 3ns) > {c}": (1, 1, 0),
    "2 * p - q / 2 > {c}": (2, 0, Fraction(-1, 2)),
    "q - p / 4 > {c}": (Fraction(-1, 4), 0, 1),
}


@pytest.mark.parametrize("text", SUMS)
def test_no_truth_next_to_a_bound_is_contradicted(text: str) -> None:
    decided = 0
    for seed in range(300):
        worlds = scene(seed, epochs=(1,))
        k = 2 + seed % (COUNT - 2)
        p, q = worlds["p"].truth, worlds["q"].truth
        value = sum(
            Fraction(c) * x for c, x in zip(SUMS[text], (p[k], p[k - 1], q[k]), strict=True)
        )
        for shift in (Fraction(-1, 16), Fraction(-1, 2**20), Fraction(1, 2**20), Fraction(1, 16)):
            bound = float(value + shift)
            formula = parse(text.format(c=f"{bound:.17g}"))
            found = evaluate(formula, {name: signal(each) for name, each in worlds.items()})
            verdict = found.at(k * PERIOD)
            assert verdict in {Verdict.POSSIBLE, Verdict(2 * (value > Fraction(bound)))}
            decided += verdict is not Verdict.POSSIBLE
    assert decided > 0


def test_more_is_decided_where_errors_are_shared() -> None:
    possible = {True: 0, False: 0}
    for seed in range(40):
        worlds = scene(seed, epochs=(1,))
        for text in FORMULAS[:8]:
            formula = parse(text.format(c=1))
            for shared in possible:
                found = evaluate(
                    formula, {n: signal(each, shared=shared) for n, each in worlds.items()}
                )
                codes = found.codes_at(np.arange(2 * PERIOD, COUNT * PERIOD))
                possible[shared] += int((codes == int(Verdict.POSSIBLE)).sum())
    assert 10 * possible[True] < 4 * possible[False]


@pytest.mark.parametrize("text", FORMULAS)
def test_online_verdicts_are_those_of_the_record(text: str) -> None:
    formula = parse(text.format(c=1))
    for seed in range(20):
        worlds = scene(seed)
        names = sorted(formula.channels)
        error = SharedError(ALPHA, BETA, name=NAME)
        units = dict.fromkeys(names, "1")
        monitor = Monitor(formula, units, shared=dict.fromkeys(names, error))
        taken = []
        for first in range(0, COUNT, 2):
            part = slice(first, first + 2)
            for name in names:
                each = worlds[name]
                monitor.extend(
                    *(name, INSTANTS[part], INSTANTS[part], each.lo[part], each.hi[part], PERIOD),
                    epoch=each.epoch[part],
                )
            taken += monitor.take()
        whole = evaluate(formula, {name: signal(worlds[name]) for name in names})
        recorded = codes_of([*whole])
        found = codes_of(taken)
        assert len(found) > 2 * PERIOD
        assert all(recorded[tick] == code for tick, code in found.items())


def test_a_difference_within_an_epoch_is_as_wide_as_its_own_errors() -> None:
    own = 2.0**-4
    lo, hi = 2.0 * (1.0 - own + BETA[0]), 2.5 * (1.0 + own + BETA[1])
    p = Signal(
        INSTANTS, INSTANTS, np.full(COUNT, lo), np.full(COUNT, hi), PERIOD, until=100,
        shared=SharedError(ALPHA, BETA),
    )  # fmt: skip
    for bound, expected in ((0.32, Verdict.CERTAIN), (0.31, Verdict.POSSIBLE)):
        found = evaluate(parse(f"abs(p - delay(p, 3ns)) < {bound}"), {"p": p})
        assert found.at(3 * PERIOD) is expected


@pytest.mark.parametrize(
    ("alpha", "beta", "epoch"),
    [
        ((0.0, 1.0), (0.0, 0.0), 1),
        ((-2.0, -1.0), (0.0, 0.0), 1),
        ((2.0, 1.0), (0.0, 0.0), 1),
        ((1.0, np.inf), (0.0, 0.0), 1),
        ((1.0, 2.0), (1.0, 0.0), 1),
        ((1.0, 2.0), (0.0, 0.0), -1),
        ((1.0, 2.0), (0.0, 0.0), 0.5),
    ],
)
def test_what_is_no_shared_error_is_refused(
    alpha: tuple[float, float], beta: tuple[float, float], epoch: float
) -> None:
    with pytest.raises(MonitorError):
        SharedError(alpha, beta, epoch)


def test_epochs_fit_the_samples() -> None:
    with pytest.raises(MonitorError):
        Signal(
            [0, 1], [0, 1], [1.0, 1.0], [2.0, 2.0], 1, shared=SharedError(ALPHA, BETA, [1, 1, 1])
        )
