"""Verdicts are those of rtamt on each end, where discrete and dense time mean the same.

Samples have exact instants a period apart, and windows are multiples of the period. The argument is
by cells, from a sample until before the next. A comparison is constant in each cell. So are
``not``, ``and``, ``or``, ``implies`` and windows of what is: a window that moves within a cell
meets the same cells. So is ``φ until[0,b] ψ``, whose witness is now, or the begin of a later cell.
It is not with a > 0: where t lies within a cell, the cell of t + a may have the only witness, and
then φ must hold in a part of that cell too. It is again if ψ implies φ. Dense ``since`` needs φ in
what is left of the cell of its witness, which discrete ``since`` does not ask for: they agree if ψ
implies φ. At the samples themselves ``until[a,b]`` of such formulas agrees for all a, and so do
``rise`` and ``fall``; they may be combined, but stand in no window.
"""

from __future__ import annotations

import json
import subprocess
from pathlib import Path
from random import Random
from typing import TYPE_CHECKING, Any, Final

from eskin.monitor import evaluate, parse
from tests.unit.eskin.monitor.oracle.draw import COMPARISONS, NAMES, WINDOWS, exact
from tests.unit.eskin.monitor.oracle.formulas import (
    Atom,
    Before,
    Both,
    Channel,
    Edge,
    Formula,
    Not,
    Number,
    Window,
    Within,
    parts,
    reach,
    write,
)
from tests.unit.eskin.monitor.oracle.library import SAID, signals
from tests.unit.eskin.monitor.oracle.semantics import enclose_truth
from tests.unit.eskin.monitor.oracle.signals import Samples

if TYPE_CHECKING:
    from tests.unit.eskin.monitor.oracle.signals import Signals

PYTHON: Final = Path(__file__).parents[5] / ".venv" / "rtamt" / "bin" / "python"
EVALUATE: Final = Path(__file__).with_name("evaluate.py")
FORMULAS: Final = 300
SAMPLES: Final = 24
PERIOD: Final = 20_000_000


def robustness(asked: list[dict[str, Any]]) -> list[list[float]]:
    """What rtamt says of each formula at each sample."""
    assert PYTHON.exists(), "rtamt is missing: run make test"
    done = subprocess.run(
        [PYTHON, EVALUATE], input=json.dumps(asked), capture_output=True, text=True,
        check=False, timeout=250,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-2000:]
    return list(json.loads(done.stdout))


def draw_window(random: Random, *, least: int = 0) -> Window:
    begin = random.randint(least, 2)
    end = begin + random.randint(0, 3)
    text = f"[{begin * PERIOD}ns,{end * PERIOD}ns]"
    return Window(begin * PERIOD, end * PERIOD, text)


def draw_in_cells(random: Random, depth: int) -> Formula:
    """A formula that is constant in each cell, and means the same in discrete time."""
    if depth == 0:
        name, comparison = random.choice(NAMES), random.choice(COMPARISONS)
        number = random.randint(0, 4)
        return Atom(Channel(name), comparison, Number(f"{number} Pa", number))
    one, other = (draw_in_cells(random, depth - 1) for _ in range(2))
    match random.randrange(6):
        case 0:
            return Not(one)
        case 1:
            return Both(random.choice(("and", "or", "implies")), one, other)
        case 2 | 3:
            return Within(random.choice(WINDOWS), draw_window(random), one)
        case 4:
            end = random.randint(0, 4) * PERIOD
            return Before("until", Window(0, end, f"[0,{end}ns]"), one, other)
    return Before(
        random.choice(("until", "since")), draw_window(random), one, Both("and", one, other)
    )


def draw_at_samples(random: Random) -> Formula:
    """A formula that means the same in discrete time at the samples."""
    one, other = (draw_in_cells(random, random.randint(0, 2)) for _ in range(2))
    match random.randrange(4):
        case 0:
            return Edge(random.choice(("rise", "fall")), one)
        case 1:
            return Before("until", draw_window(random, least=1), one, other)
        case 2:
            return Both(random.choice(("and", "or", "implies")), draw_at_samples(random), Not(one))
    return draw_in_cells(random, 3)


def draw_signals(random: Random) -> Signals:
    """Values between thresholds, so that none is equal to one."""
    known = {}
    for name in NAMES:
        lo = [random.randint(-1, 4) for _ in range(SAMPLES)]
        width = [random.choice((0, 0, 0, 1, 2)) for _ in range(SAMPLES)]
        instants = tuple(k * PERIOD for k in range(SAMPLES))
        known[name] = Samples(
            instants,
            instants,
            tuple(exact(low + 0.5) for low in lo),
            tuple(exact(low + wide + 0.5) for low, wide in zip(lo, width, strict=True)),
            PERIOD,
            (False,) * SAMPLES,
        )
    return known


def on_one_end(formula: Formula, *, lower: bool) -> str:
    """In rtamt's language, for the lower evaluation or the upper one.

    A channel has a variable for each end. Below a negation the ends are exchanged, which is what
    the negation normal form comes to.
    """

    def inner(part: Formula) -> str:
        return on_one_end(part, lower=lower)

    match formula:
        case Atom(Channel(name), comparison, Number(_, number)):
            end = "lo" if (comparison in {">", ">="}) == lower else "hi"
            return f"({variable(name, end)} {comparison} {number})"
        case Not(operand):
            return f"(not {on_one_end(operand, lower=not lower)})"
        case Both("implies", left, right):
            return f"((not {on_one_end(left, lower=not lower)}) or {inner(right)})"
        case Both(name, left, right):
            return f"({inner(left)} {name} {inner(right)})"
        case Within(name, window, operand):
            return f"({name}{in_periods(window)} {inner(operand)})"
        case Before(name, window, left, right):
            return f"({inner(left)} {name}{in_periods(window)} {inner(right)})"
        case Edge(name, operand):
            # The end differs now and before: from the previous sample's negation to now.
            now, before = (
                on_one_end(operand, lower=at)
                for at in ((lower, not lower) if name == "rise" else (not lower, lower))
            )
            if name == "rise":
                return f"({now} and not (once[1:1] {before}))"
            return f"((not {now}) and (once[1:1] {before}))"
    raise AssertionError(formula)


def variable(name: str, end: str) -> str:
    return f"{name.replace('.', '_')}_{end}"


def in_periods(window: Window) -> str:
    return f"[{window.begin // PERIOD}:{int(window.end) // PERIOD}]"


def has_edge(formula: Formula) -> bool:
    return isinstance(formula, Edge) or any(has_edge(part) for part in parts(formula))


def test_verdicts_are_those_of_rtamt_on_each_end() -> None:
    scenes = []
    for seed in range(FORMULAS):
        random = Random(seed)
        scenes.append((draw_at_samples(random), draw_signals(random)))
    asked = [
        {
            "formula": on_one_end(formula, lower=lower),
            "signals": {
                variable(name, end): [float(value) for value in getattr(samples, end)]
                for name, samples in known.items()
                for end in ("lo", "hi")
            },
        }
        for formula, known in scenes
        for lower in (True, False)
    ]
    found = robustness(asked)
    compared = 0
    for n, (formula, known) in enumerate(scenes):
        lower, upper = enclose_truth(formula, known)
        verdicts = evaluate(parse(write(formula)), signals(known))
        past, future = (int(length) // PERIOD for length in reach(formula))
        for k in range(past + has_edge(formula), SAMPLES - future):
            said = (found[2 * n][k] > 0, found[2 * n + 1][k] > 0)
            assert verdicts.at(k * PERIOD) is SAID[said], (n, k, write(formula))
            assert said == (lower(k * PERIOD), upper(k * PERIOD)), (n, k, write(formula))
            compared += 1
    assert compared > 5 * FORMULAS
