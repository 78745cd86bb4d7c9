from __future__ import annotations

import random

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from eskin.errors import MonitorError
from eskin.interval import Verdict
from eskin.monitor import Formula, Monitor, Piece, Signal, evaluate, parse
from tests.unit.eskin.monitor.test_evaluation import FORMULAS, PERIOD, samples
from tests.unit.eskin.monitor.worlds import Sample, signal

TICKS = np.arange(-20, 110)


def codes_of(pieces: list[Piece]) -> dict[int, int]:
    """The verdict at each of `TICKS` that some piece covers."""
    found: dict[int, int] = {}
    for piece in pieces:
        first = -1000 if piece.start is None else 2 * piece.start + (not piece.includes_start)
        last = 1000 if piece.end is None else 2 * piece.end - (not piece.includes_end)
        for tick in TICKS[(first <= TICKS) & (last >= TICKS)].tolist():
            assert tick not in found
            found[tick] = int(piece.verdict)
    return found


@settings(max_examples=60)
@given(FORMULAS, samples(exact=False), samples(exact=False), st.integers(0, 2**32))
def test_online_verdicts_are_those_of_the_record(
    formula: Formula, p: list[Sample], q: list[Sample], seed: int
) -> None:
    chance = random.Random(seed)  # noqa: S311 - drawn from a seed
    monitor = Monitor(formula, {"p": "1", "q": "1"})
    left, right = [("p", each) for each in p], [("q", each) for each in q]
    taken: list[Piece] = []
    views = []
    while left or right:
        name, sample = (left if left and (not right or chance.random() < 0.5) else right).pop(0)
        if name in formula.channels:
            monitor.push(name, sample.earliest, sample.latest, sample.lo, sample.hi, period=PERIOD)
            if sample.gap:
                monitor.gap(name)
        if chance.random() < 0.5:
            taken += monitor.take()
        views.append(monitor.verdicts)
    taken += monitor.take()
    whole = evaluate(formula, {"p": signal(p, PERIOD), "q": signal(q, PERIOD)})
    recorded = codes_of([*whole])
    for tick, code in codes_of(taken).items():
        assert recorded[tick] == code, (str(formula), tick)
    # What is final at the end was taken, as far as there is no hole.
    reach = whole.final_until(-(2**63 - 1))
    decided = {tick for tick in TICKS.tolist() if reach is not None and tick <= reach}
    assert set(codes_of(taken)) >= decided


@settings(max_examples=40)
@given(FORMULAS, samples(exact=False), samples(exact=False), st.integers(1, 4))
def test_stretches_are_as_their_samples(
    formula: Formula, p: list[Sample], q: list[Sample], size: int
) -> None:
    one, other = (Monitor(formula, {"p": "1", "q": "1"}) for _ in range(2))
    channels = [("p", p)] * ("p" in formula.channels) + [("q", q)] * ("q" in formula.channels)
    for name, all_ in channels:
        for first in range(0, len(all_), size):
            stretch = all_[first : first + size]
            for each in stretch:
                one.push(name, each.earliest, each.latest, each.lo, each.hi, period=PERIOD)
                if each.gap:
                    one.gap(name)
            rows = [(each.earliest, each.latest, each.lo, each.hi) for each in stretch]
            gaps = [each.gap for each in stretch]
            earliest, latest, lo, hi = zip(*rows, strict=True)
            other.extend(name, earliest, latest, lo, hi, PERIOD, gaps)
            assert one.take() == other.take()
    assert len(one) == len(other)


@settings(max_examples=60)
@given(FORMULAS, samples(exact=False), samples(exact=False), st.integers(0, 4), st.integers(0, 4))
def test_what_is_final_stays(
    formula: Formula, p: list[Sample], q: list[Sample], some: int, more: int
) -> None:
    early = evaluate(formula, {"p": signal(p[:some], PERIOD), "q": signal(q[:more], PERIOD)})
    late = evaluate(formula, {"p": signal(p, PERIOD), "q": signal(q, PERIOD)})
    times = np.arange(-10, 50)
    final = early.final_at(times)
    assert np.array_equal(early.codes_at(times)[final], late.codes_at(times)[final])


def test_memory_is_bounded() -> None:
    monitor = Monitor(parse("always[0,64ns] p > 0 and once[0,64ns] p > 1"), {"p": "1"})
    most = 0
    for k in range(2000):
        monitor.push("p", k, k, 1.0, 2.0, period=1)
        if k % 50 == 49:
            monitor.take()
            most = max(most, len(monitor))
    assert most < 200


def test_a_long_record_is_decided_as_a_whole() -> None:
    formula = parse(
        "(abs(p) > 0.5 implies eventually[0,200ms] p < 0.2) and once[0,300ms] q > 0.5 or p < q - 1"
    )
    count, period = 2000, 20_000_000
    instants = np.arange(count, dtype=np.int64) * period
    noise = np.random.default_rng(1).normal(size=(2, count))
    values = np.sin(np.pi * instants / 1e9) + 0.2 * noise
    monitor, taken, size = Monitor(formula, {"p": "1", "q": "1"}), [], 0
    for first in range(0, count, 7):
        part = slice(first, first + 7)
        for name, column in zip("pq", values, strict=True):
            lo, hi = column[part] - 0.1, column[part] + 0.1
            monitor.extend(name, instants[part], instants[part] + 1000, lo, hi, period)
        taken += monitor.take()
        size = max(size, len(monitor))
    assert size < 100
    signals = {
        name: Signal(instants, instants + 1000, column - 0.1, column + 0.1, period)
        for name, column in zip("pq", values, strict=True)
    }
    whole = [*evaluate(formula, signals).pieces(last=2 * int(taken[-1].end or 0))]
    joined = [
        each
        for each, before in zip(taken, [None, *taken], strict=False)
        if before is None or each.verdict is not before.verdict
    ]
    starts = [(each.start, each.includes_start, each.verdict) for each in joined]
    assert len(starts) > 100
    assert starts == [(each.start, each.includes_start, each.verdict) for each in whole]


def test_a_decided_window_is_final_at_once() -> None:
    monitor = Monitor(parse("eventually[0,1s] p > 3"), {"p": "1"})
    monitor.push("p", 10, 10, 1.0, 1.0, period=10)
    monitor.push("p", 20, 20, 5.0, 5.0, period=10)
    monitor.push("p", 30, 30, 5.0, 5.0, period=10)
    assert monitor.verdicts.at(15) is Verdict.CERTAIN
    assert monitor.verdicts.final(15)
    assert not monitor.verdicts.final(10**9)


def test_a_hold_and_a_gap_let_time_pass() -> None:
    monitor = Monitor(parse("always[0,100ns] p > 3"), {"p": "1"})
    monitor.push("p", 0, 0, 5.0, 5.0, period=10)
    assert monitor.verdicts.at(0) is Verdict.POSSIBLE
    monitor.hold("p", 200)
    assert monitor.verdicts.at(0) is Verdict.CERTAIN
    assert monitor.verdicts.final(0)
    with pytest.raises(MonitorError):
        monitor.gap("p")
    monitor.push("p", 200, 200, 5.0, 5.0, period=10)
    monitor.gap("p", 1000)
    assert monitor.verdicts.at(109) is Verdict.CERTAIN
    assert monitor.verdicts.at(110) is Verdict.POSSIBLE
    assert monitor.verdicts.final(110)


def test_what_cannot_be_pushed_is_refused() -> None:
    monitor = Monitor(parse("p > q"), {"p": "1", "q": "1"}, capacity=3)
    for k in range(3):
        monitor.push("p", k, k, 1.0, 2.0, period=1)
    with pytest.raises(MonitorError):
        monitor.push("p", 3, 3, 1.0, 2.0, period=1)
    with pytest.raises(MonitorError):
        monitor.push("r", 3, 3, 1.0, 2.0, period=1)
    for sample in ((5, 4, 1.0, 2.0), (5, 6, 2.0, 1.0), (5, 6, np.nan, 1.0)):
        with pytest.raises(MonitorError):
            monitor.push("q", *sample, period=1)
    with pytest.raises(MonitorError):
        monitor.extend("q", [6, 7], [7], [1.0], [2.0], 1)
    with pytest.raises(MonitorError):
        monitor.extend("q", [6.5], [7.0], [1.0], [2.0], 1)
    with pytest.raises(MonitorError):
        monitor.extend("q", [6, 5], [7, 5], [1.0, 1.0], [2.0, 2.0], 1)
    assert len(monitor) == 4
    with pytest.raises(MonitorError):
        Monitor(parse("always p > 1"), {"p": "1"})
