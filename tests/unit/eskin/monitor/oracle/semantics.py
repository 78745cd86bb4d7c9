"""What a formula means: in one world, and over all that is known."""

from __future__ import annotations

from functools import cache
from itertools import product
from operator import ge, gt, le, lt
from typing import TYPE_CHECKING, Final, TypeAlias

from tests.unit.eskin.monitor.oracle import traces
from tests.unit.eskin.monitor.oracle.formulas import (
    NEGATED,
    Atom,
    Before,
    Both,
    Count,
    Edge,
    Formula,
    Not,
    Within,
    named,
)
from tests.unit.eskin.monitor.oracle.intervals import Interval, enclose, value
from tests.unit.eskin.monitor.oracle.traces import Trace, combine

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from tests.unit.eskin.monitor.oracle.signals import Samples, World

COMPARE: Final = {"<": lt, "<=": le, ">": gt, ">=": ge}
Pair: TypeAlias = "tuple[Trace[bool], Trace[bool]]"
"""Where a formula certainly holds, and where it possibly does."""


def holds(formula: Formula, world: World) -> Trace[bool]:
    """Where a formula holds in a world.

    Raises:
        ZeroDivisionError: An expression has no value somewhere.
    """
    match formula:
        case Atom(left, comparison, right):
            names = list(dict.fromkeys((*named(left), *named(right))))

            @cache
            def compare(*point: object) -> bool:
                at = dict(zip(names, point, strict=True))
                return bool(COMPARE[comparison](value(left, at), value(right, at)))  # type: ignore[arg-type]

            return combine(compare, [world[name] for name in names])
        case Not(operand):
            return _not(holds(operand, world))
        case Both(name, left, right):
            return _both(name, holds(left, world), holds(right, world))
        case Within():
            return _within(formula, holds(formula.operand, world))
        case Before():
            return _before(formula, holds(formula.left, world), holds(formula.right, world))
        case Edge(name, operand):
            inner = holds(operand, world)
            return _edge(name, (inner, inner))
        case Count(operands):
            return _count(formula, [holds(each, world) for each in operands])


def enclose_truth(formula: Formula, known: Mapping[str, Samples]) -> Pair:
    """The two evaluations of a formula by definition, over all that is known of its channels.

    An atom holds certainly where it does for all values of all samples that may hold there, and
    possibly where it does for one.
    """
    match formula:
        case Atom():
            return _atom(formula, known)
        case Not(operand):
            lower, upper = enclose_truth(operand, known)
            return _not(upper), _not(lower)
        case Both("implies", left, right):
            (first, second), (lower, upper) = (enclose_truth(f, known) for f in (left, right))
            return _both("implies", second, lower), _both("implies", first, upper)
        case Both(name, left, right):
            (a, b), (c, d) = (enclose_truth(f, known) for f in (left, right))
            return _both(name, a, c), _both(name, b, d)
        case Within():
            a, b = enclose_truth(formula.operand, known)
            return _within(formula, a), _within(formula, b)
        case Before():
            (a, b), (c, d) = (enclose_truth(f, known) for f in (formula.left, formula.right))
            return _before(formula, a, c), _before(formula, b, d)
        case Edge(name, operand):
            lower, upper = enclose_truth(operand, known)
            return _edge(name, (lower, upper)), _edge(name, (upper, lower))
        case Count(operands, comparison, _):
            least, most = zip(*(enclose_truth(each, known) for each in operands), strict=True)
            if comparison in {"<", "<="}:
                least, most = most, least
            return _count(formula, least), _count(formula, most)


def _atom(atom: Atom, known: Mapping[str, Samples]) -> Pair:
    left, right = atom.left, atom.right
    names = list(dict.fromkeys((*named(left), *named(right))))

    def true_for_all(comparison: str, box: dict[str, Interval]) -> bool:
        (a, b), (c, d) = enclose(left, box), enclose(right, box)
        return bool(COMPARE[comparison](*((a, d) if comparison in {">", ">="} else (b, c))))

    @cache
    def over(*held: frozenset[Interval]) -> tuple[bool, bool]:
        boxes = [dict(zip(names, box, strict=True)) for box in product(*held)]
        return (
            all(true_for_all(atom.comparison, box) for box in boxes),
            not all(true_for_all(NEGATED[atom.comparison], box) for box in boxes),
        )

    both = combine(over, [known[name].sets() for name in names])
    return combine(lambda pair: pair[0], [both]), combine(lambda pair: pair[1], [both])


def _not(trace: Trace[bool]) -> Trace[bool]:
    return combine(lambda truth: not truth, [trace])


def _both(name: str, left: Trace[bool], right: Trace[bool]) -> Trace[bool]:
    match name:
        case "and":
            return combine(lambda a, b: a and b, [left, right])
        case "or":
            return combine(lambda a, b: a or b, [left, right])
    return combine(lambda a, b: not a or b, [left, right])


def _within(formula: Within, inner: Trace[bool]) -> Trace[bool]:
    begin: float
    begin, end = formula.window.begin, formula.window.end
    if formula.name in {"historically", "once"}:
        begin, end = -end, -begin
    quantify = traces.every if formula.name in {"always", "historically"} else traces.some
    return quantify(inner, begin, end)


def _before(formula: Before, left: Trace[bool], right: Trace[bool]) -> Trace[bool]:
    quantify = traces.until if formula.name == "until" else traces.since
    return quantify(left, right, formula.window.begin, formula.window.end)


def _count(formula: Count, operands: Sequence[Trace[bool]]) -> Trace[bool]:
    compare = COMPARE[formula.comparison]
    return combine(lambda *truths: bool(compare(sum(truths), formula.number)), operands)


def _edge(name: str, inner: Pair) -> Trace[bool]:
    """Where the first holds and the second did not immediately before, or the reverse."""
    now, earlier = inner
    times = {*now.times, *earlier.times}
    if name == "rise":
        return traces.make(times, lambda t: now(t) and not earlier.before(t))
    return traces.make(times, lambda t: not earlier(t) and now.before(t))
