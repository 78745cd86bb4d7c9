"""The node's engine says what the library says of the same samples, at each sample."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import pytest
from eskin_sensor_node.firmware import monitor as engine
from eskin_sensor_node.firmware.reflex import Reflex
from eskin_sensor_node.machine.monitor_program import MonitorProgram
from hypothesis import given, settings
from hypothesis import strategies as st

from eskin.monitor import Atom, Channel, Comparison, Constant, Formula, Signal, evaluate, parse
from eskin.monitor.formula import Always, Eventually, Until
from eskin.monitor.program import Op, instructions, threshold
from tests.unit.eskin.monitor.formulas import bounds, formulas

if TYPE_CHECKING:
    from collections.abc import Callable

PERIODS: Final = {"p": 3, "q": 4}
UNITS: Final = {"p": "1", "q": "1"}
CODES: Final = 5
"""Code c means the interval from c - 1 to c."""
ATOMS = st.builds(
    Atom,
    st.sampled_from("pq").map(Channel),
    st.sampled_from(Comparison),
    st.sampled_from([Constant(k) for k in range(4)]),
)


def is_past(formula: Formula) -> bool:
    return not any(isinstance(node, Always | Eventually | Until) for node in formula.walk())


FORMULAS = formulas(ATOMS, bounds(9, unbounded=False), max_leaves=4).filter(is_past)
SAMPLES = st.lists(st.none() | st.integers(0, CODES - 1), min_size=1, max_size=12)


def scaled(formula: Formula, scale: int) -> Formula:
    """The formula with longer windows."""
    if isinstance(formula, Atom):
        return formula
    changes: dict[str, Any] = {}
    for field in fields(formula):
        value = getattr(formula, field.name)
        if isinstance(value, Formula):
            changes[field.name] = scaled(value, scale)
        elif field.name == "operands":
            changes["operands"] = tuple(scaled(each, scale) for each in value)
        elif field.name == "bounds":
            changes["bounds"] = tuple(scale * bound for bound in value)
    return replace(formula, **changes)


def codes_of(value: float, side: int, *, upward: bool) -> tuple[int, int]:
    """Codes of which one end, or the other one, fulfils a comparison; by looking at each."""
    found = []
    for code in range(CODES):
        end = code - side if upward else code - 1 + side
        if end >= value if upward else end <= value:
            found.append(code)
    return (found[0], found[-1]) if found else (1, 0)


def build(
    formula: Formula, scale: int, drift: int
) -> tuple[engine.Monitor, dict[str, engine.Source]]:
    sources = {name: engine.Source(scale * period, drift) for name, period in PERIODS.items()}
    atoms = list(dict.fromkeys(node for node in formula.walk() if isinstance(node, Atom)))
    made: list[engine.Threshold] = []
    for atom in atoms:
        found = threshold(atom, UNITS)
        assert found is not None
        certain, possible = (codes_of(found.value, side, upward=found.upward) for side in (1, 0))
        made.append(engine.Threshold(sources[found.channel], 0, derived=False))
        made[-1].set(certain, possible)
    lines = [
        (op, taken, scale * a if op != Op.ATOM else a, scale * b, number)
        for op, taken, a, b, number in instructions(formula, {a: k for k, a in enumerate(atoms)})
    ]
    return engine.Monitor(lines, made, 1000 * scale, drift), sources


def run(
    formula: Formula, samples: dict[str, list[int | None]], scale: int = 1, drift: int = 0
) -> dict[int, int]:
    """The engine's verdict at each instant of a sample."""
    monitor, sources = build(formula, scale, drift)
    instants = {
        scale * PERIODS[name] * k
        for name, codes in samples.items()
        for k, code in enumerate(codes)
        if code is not None
    }
    verdicts = {}
    for now in sorted(instants):
        for name, codes in samples.items():
            place, rest = divmod(now, scale * PERIODS[name])
            code = codes[place] if rest == 0 and place < len(codes) else None
            if code is not None:
                sources[name].take(now, [[code]])
        reflex = Reflex("", monitor, engine.CERTAIN, "", 1.0)
        if reflex.compare(now):
            verdicts[now] = monitor.step(now)
        for source in sources.values():
            source.fresh = False
    return verdicts


def signal_of(
    name: str,
    codes: list[int | None],
    instant: Callable[[int], int] = lambda tick: tick,
    scale: int = 1,
    until: int = 1000,
) -> Signal:
    period = scale * PERIODS[name]
    kept = [k for k, code in enumerate(codes) if code is not None]
    gap = [codes[k + 1] is None if k + 1 < len(codes) else True for k in kept]
    instants = [instant(period * k) for k in kept]
    lo = [float(codes[k]) - 1.0 for k in kept]  # type: ignore[arg-type]
    return Signal(
        *(instants, instants, lo, np.array(lo) + 1.0, period, np.array(gap, bool)),
        unit="1",
        until=until,
    )


@settings(max_examples=400)
@given(FORMULAS, SAMPLES, SAMPLES)
def test_verdicts_are_those_of_the_library(
    formula: Formula, p: list[int | None], q: list[int | None]
) -> None:
    samples = {"p": p, "q": q}
    found = run(formula, samples)
    record = evaluate(formula, {name: signal_of(name, each) for name, each in samples.items()})
    instants = np.array(sorted(found), np.int64)
    assert [found[now] for now in instants.tolist()] == record.codes_at(instants).tolist()


LONG = (
    "once[0,6ns] rise(p > 1)",
    "once[3ns,8ns] fall(q > 1)",
    "historically[0,9ns](p > 0 or q > 2)",
    "not once[4ns,12ns](p > 2 and q > 2)",
    "(p > 0 since[0,12ns] rise(q > 1)) or q <= 0",
    "q < 3 since[4ns,8ns] p > 2",
    "rise(p > 1) and once[2ns,9ns] rise(p > 1)",
    "count(once[0,3ns] p > 2, once[0,4ns] q > 2, p > 1) >= 2",
)


def records(seed: int) -> dict[str, list[int | None]]:
    """Codes of both channels, a few missing."""
    draw = np.random.default_rng(seed)
    found: dict[str, list[int | None]] = {}
    for name, count in (("p", 400), ("q", 300)):
        codes = draw.integers(0, CODES, count).tolist()
        found[name] = [None if draw.random() < 0.05 else code for code in codes]
    return found


@pytest.mark.parametrize("text", LONG)
def test_verdicts_of_a_long_record_are_those_of_the_library(text: str) -> None:
    formula, samples = parse(text), records(1)
    found = run(formula, samples)
    signals = {name: signal_of(name, each, until=5000) for name, each in samples.items()}
    instants = np.array(sorted(found), np.int64)
    codes = evaluate(formula, signals).codes_at(instants)
    assert [found[now] for now in instants.tolist()] == codes.tolist()
    assert len(set(codes.tolist())) > 1


@pytest.mark.parametrize("rate", [-1.0, -0.5, 0.0, 0.7, 1.0])
@pytest.mark.parametrize("text", LONG)
def test_verdicts_hold_whatever_the_rate_of_the_clock_is(text: str, rate: float) -> None:
    formula, samples, scale, drift = parse(text), records(2), 1_000_000, 100_000

    def true_time(ticks: int) -> int:
        return ticks + int(rate * drift * ticks / 1e9)

    found = run(formula, samples, scale, drift)
    signals = {
        name: signal_of(name, each, true_time, scale, until=5000 * scale)
        for name, each in samples.items()
    }
    record = evaluate(scaled(formula, scale), signals)
    decided = {now: verdict for now, verdict in found.items() if verdict != engine.POSSIBLE}
    truths = record.codes_at(np.array([true_time(now) for now in decided], np.int64)).tolist()
    assert [*decided.values()] == truths
    assert len(decided) > 50


@pytest.mark.nightly
@settings(max_examples=300)
@given(FORMULAS, st.lists(st.integers(0, CODES - 1), min_size=30, max_size=40), st.integers(3, 4))
def test_work_is_bounded_by_what_the_program_states(
    formula: Formula, codes: list[int], other: int
) -> None:
    monitor, sources = build(formula, 1, 0)
    atoms = tuple(dict.fromkeys(node for node in formula.walk() if isinstance(node, Atom)))
    lines = instructions(formula, {atom: k for k, atom in enumerate(atoms)})
    program = MonitorProgram(formula, tuple(lines), atoms, 0)
    for now in range(12 * len(codes)):
        for name, source in sources.items():
            place, rest = divmod(now, 3 if name == "p" else other)
            source.fresh = rest == 0
            if source.fresh:
                source.take(now, [[codes[(place + (name == "q")) % len(codes)]]])
        before = monitor.work
        if Reflex("", monitor, engine.CERTAIN, "", 1.0).compare(now):
            monitor.step(now)
        if now > 24:
            assert monitor.work - before <= program.work
