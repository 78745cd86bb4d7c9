"""Signals with a truth in them, and truth itself by the definitions, instant by instant."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from typing import TYPE_CHECKING

from eskin.monitor import (
    Absolute,
    Add,
    Always,
    And,
    Atom,
    Channel,
    Comparison,
    Constant,
    Count,
    Divide,
    Eventually,
    Expression,
    Fall,
    Formula,
    Historically,
    Implies,
    Maximum,
    Minimum,
    Multiply,
    Negate,
    Not,
    Once,
    Or,
    Rise,
    Signal,
    Since,
    Subtract,
    Until,
)

if TYPE_CHECKING:
    from collections.abc import Callable

FAR = 20
"""ns: a window without end is cut there, where nothing changes any more."""


@dataclass(frozen=True)
class Sample:
    earliest: int
    latest: int
    lo: float
    hi: float
    gap: bool = False


def signal(samples: list[Sample], period: int, **options: object) -> Signal:
    return Signal(
        [each.earliest for each in samples],
        [each.latest for each in samples],
        [each.lo for each in samples],
        [each.hi for each in samples],
        period,
        [each.gap for each in samples] if samples else None,
        **options,  # type: ignore[arg-type]
    )


def held(
    samples: list[Sample],
    instants: list[Fraction],
    values: list[float],
    period: int,
    unknown: Callable[[Fraction], float],
) -> Callable[[Fraction], float]:
    """The value at each time for one choice of instants, values, and what is not known."""

    def value(t: Fraction) -> float:
        last = max((k for k, instant in enumerate(instants) if instant <= t), default=-1)
        if last < 0:
            return unknown(t)
        pending = last == len(samples) - 1 and t > instants[last]
        lost = samples[last].gap and t >= instants[last] + period
        return unknown(t) if pending or lost else values[last]

    return value


class Truth:
    """Evaluates formulas at times by their definitions, on a grid of quarters of a ns.

    Between whole ns nothing changes, so quarters represent each open interval, with room for one
    time before another in it.
    """

    def __init__(self, values: dict[str, Callable[[Fraction], float]]) -> None:
        self._values = values
        self._known: dict[tuple[Formula, Fraction], bool] = {}

    def __call__(self, formula: Formula, t: Fraction) -> bool:
        # One time for each open interval between two ns.
        key = formula, t if t.denominator == 1 else t // 1 + Fraction(1, 2)
        if key not in self._known:
            self._known[key] = self._evaluate(formula, key[1])
        return self._known[key]

    def _evaluate(self, node: Formula, t: Fraction) -> bool:  # noqa: C901, PLR0911
        if isinstance(node, Atom):
            one, other = self._value(node.left, t), self._value(node.right, t)
            return {
                Comparison.GREATER: one > other,
                Comparison.GREATER_EQUAL: one >= other,
                Comparison.LESS: one < other,
                Comparison.LESS_EQUAL: one <= other,
            }[node.comparison]
        if isinstance(node, Not):
            return not self(node.operand, t)
        if isinstance(node, And):
            return all(self(part, t) for part in node.operands)
        if isinstance(node, Or):
            return any(self(part, t) for part in node.operands)
        if isinstance(node, Implies):
            return not self(node.left, t) or self(node.right, t)
        if isinstance(node, Count):
            count = sum(self(part, t) for part in node.operands)
            number = node.number
            return {
                Comparison.GREATER: count > number,
                Comparison.GREATER_EQUAL: count >= number,
                Comparison.LESS: count < number,
                Comparison.LESS_EQUAL: count <= number,
            }[node.comparison]
        before = t if (2 * t) % 2 else t - Fraction(1, 2)
        if isinstance(node, Rise):
            return self(node.operand, t) and not self(node.operand, before)
        if isinstance(node, Fall):
            return not self(node.operand, t) and self(node.operand, before)
        if isinstance(node, Always | Eventually):
            window = self._times(t, *node.bounds)
            return (all if isinstance(node, Always) else any)(
                self(node.operand, each) for each in window
            )
        if isinstance(node, Historically | Once):
            window = [2 * t - each for each in self._times(t, *node.bounds)]
            return (all if isinstance(node, Historically) else any)(
                self(node.operand, each) for each in window
            )
        assert isinstance(node, Until | Since)
        for ahead in self._times(t, *node.bounds):
            then = ahead if isinstance(node, Until) else 2 * t - ahead
            between = quarters(t, then) if isinstance(node, Until) else quarters(then, t)
            inside = [each for each in between if each != then]
            if self(node.right, then) and all(self(node.left, each) for each in inside):
                return True
        return False

    def _times(self, t: Fraction, a: int, b: int | None) -> list[Fraction]:
        return quarters(t + a, t + (max(FAR, a) if b is None else b))

    def _value(self, node: Expression, t: Fraction) -> Fraction:  # noqa: PLR0911
        if isinstance(node, Channel):
            return Fraction(self._values[node.name](t - node.delay))
        if isinstance(node, Constant):
            return node.value
        parts = [self._value(part, t) for part in node.parts if isinstance(part, Expression)]
        if isinstance(node, Negate):
            return -parts[0]
        if isinstance(node, Absolute):
            return abs(parts[0])
        if isinstance(node, Add):
            return parts[0] + parts[1]
        if isinstance(node, Subtract):
            return parts[0] - parts[1]
        if isinstance(node, Multiply):
            return parts[0] * parts[1]
        if isinstance(node, Divide):
            return parts[0] / parts[1]
        assert isinstance(node, Minimum | Maximum)
        return (min if isinstance(node, Minimum) else max)(parts)


def quarters(first: Fraction, last: Fraction) -> list[Fraction]:
    """All quarters of a ns from one time to another."""
    begin = -((-4 * first) // 1)
    return [Fraction(each, 4) for each in range(int(begin), int(4 * last) + 1)]
