"""How far a formula is from changing its truth in one world."""

from __future__ import annotations

from itertools import pairwise
from math import inf
from typing import TYPE_CHECKING, assert_never

from tests.unit.eskin.monitor.oracle import traces
from tests.unit.eskin.monitor.oracle.formulas import (
    Atom,
    Before,
    Both,
    Count,
    Edge,
    Formula,
    Not,
    Rational,
    Within,
    named,
)
from tests.unit.eskin.monitor.oracle.intervals import Bound, value
from tests.unit.eskin.monitor.oracle.traces import Instant, Trace, combine, make

if TYPE_CHECKING:
    from collections.abc import Iterator

    from tests.unit.eskin.monitor.oracle.signals import World


def robustness(formula: Formula, world: World) -> Trace[Bound]:
    """The difference that decides, negative where the formula is false.

    Source: Donzé, Maler, "Robust satisfaction of temporal logic over real-valued signals" (2010).
    """
    match formula:
        case Atom(comparison=comparison) as atom:
            names = list(dict.fromkeys((*named(atom.left), *named(atom.right))))
            sign = 1 if comparison in {">", ">="} else -1

            def difference(*point: Rational) -> Bound:
                at = dict(zip(names, point, strict=True))
                return sign * (value(atom.left, at) - value(atom.right, at))

            return combine(difference, [world[name] for name in names])
        case Not(operand):
            return combine(lambda v: -v, [robustness(operand, world)])
        case Both(name, left, right):
            both = [robustness(left, world), robustness(right, world)]
            if name == "and":
                return combine(min, both)
            return combine(max if name == "or" else lambda a, b: max(-a, b), both)
        case Within(name, window, operand):
            inner = robustness(operand, world)
            begin: float = window.begin
            end = window.end
            if name in {"historically", "once"}:
                begin, end = -end, -begin
            pick = min if name in {"always", "historically"} else max
            times = traces.shifted(inner, begin, end)
            return make(times, lambda t: pick(inner.within(t + begin, t + end)))
        case Before(name, window, left, right):
            both = [robustness(left, world), robustness(right, world)]
            if name == "since":
                both = [traces.reversed_in_time(each) for each in both]
            found = _until(both[0], both[1], window.begin, window.end)
            return found if name == "until" else traces.reversed_in_time(found)
        case Edge(name, operand):
            inner = robustness(operand, world)
            sign = 1 if name == "rise" else -1
            return make(inner.times, lambda t: min(sign * inner(t), -sign * inner.before(t)))
        case Count(operands, comparison, number):
            least = number + (comparison in {">", "<="})
            sign = 1 if comparison in {">", ">="} else -1

            def counted(*each: Bound) -> Bound:
                if least <= 0 or least > len(each):
                    return sign * (inf if least <= 0 else -inf)
                return sign * sorted(each, reverse=True)[least - 1]

            return combine(counted, [robustness(each, world) for each in operands])
    assert_never(formula)


def _until(left: Trace[Bound], right: Trace[Bound], begin: int, end: float) -> Trace[Bound]:
    """The best of all t' in the window: the worst of right at t' and of left in ``[t, t')``."""

    def best(t: Instant) -> Bound:
        return max(_choices(t))

    def _choices(t: Instant) -> Iterator[Bound]:
        first = t + begin
        edges = [u for u in {*left.times, *right.times} if first <= u and u - t <= end]
        last = max(edges, default=first) + 1 if end == inf else t + int(end)
        stops: list[Instant] = sorted({first, last, *edges})
        middles = [traces.middle(a, b) for a, b in pairwise(stops)]
        for stop in (*stops, *middles):
            inner = [t, *(u for u in left.times if t < u < stop)] if stop > t else []
            yield min([right(stop), *(v for u in inner for v in (left(u), left.after(u)))])

    times = traces.shifted(left, 0, begin, end) | traces.shifted(right, 0, begin, end)
    return make(times, best)
