"""Interval arithmetic over rational numbers, unbounded where nothing is known."""

from __future__ import annotations

from fractions import Fraction
from math import inf
from typing import TYPE_CHECKING, Final, TypeAlias

from tests.unit.eskin.monitor.oracle.formulas import (
    Channel,
    Expression,
    Number,
    Operation,
    Rational,
)

if TYPE_CHECKING:
    from collections.abc import Mapping

Bound: TypeAlias = Rational | float
"""A rational number, or an infinity."""
Interval: TypeAlias = tuple[Bound, Bound]
ANY: Final[Interval] = (-inf, inf)


def enclose(expression: Expression, box: Mapping[str, Interval]) -> Interval:
    """The range of an expression over a box, each occurrence of a channel by itself."""
    match expression:
        case Channel(name):
            return box[name]
        case Number(_, value):
            return value, value
        case Operation(name, operands):
            given = [enclose(operand, box) for operand in operands]
            match name:
                case "neg":
                    return _negate(given[0])
                case "abs":
                    lo, hi = given[0]
                    if lo >= 0:
                        return lo, hi
                    return (-hi, -lo) if hi <= 0 else (0, max(hi, -lo))
                case "min" | "max":
                    order = 1 if name == "min" else -1
                    lo, hi = given[0]
                    for a, b in given[1:]:
                        lo, hi = (
                            a if order * a < order * lo else lo,
                            b if order * b < order * hi else hi,
                        )
                    return lo, hi
                case "+":
                    return _add(*given)
                case "-":
                    return _add(given[0], _negate(given[1]))
                case "*":
                    return _multiply(*given)
                case "/":
                    lo, hi = given[1]
                    if lo <= 0 <= hi:
                        return ANY
                    return _multiply(given[0], (_invert(hi), _invert(lo)))
    raise AssertionError(expression)


def value(expression: Expression, point: Mapping[str, Rational]) -> Rational:
    """The value of an expression.

    Raises:
        ZeroDivisionError: It has none.
    """
    match expression:
        case Channel(name):
            return point[name]
        case Number(_, number):
            return number
        case Operation(name, operands):
            given = [value(operand, point) for operand in operands]
            match name:
                case "neg":
                    return -given[0]
                case "abs":
                    return -given[0] if given[0] < 0 else given[0]
                case "min":
                    return min(given, key=Fraction)
                case "max":
                    return max(given, key=Fraction)
                case "+":
                    return given[0] + given[1]
                case "-":
                    return given[0] - given[1]
                case "*":
                    return given[0] * given[1]
                case "/":
                    return Fraction(given[0]) / given[1]
    raise AssertionError(expression)


def _negate(of: Interval) -> Interval:
    return -of[1], -of[0]


def _add(left: Interval, right: Interval) -> Interval:
    return left[0] + right[0], left[1] + right[1]


def _invert(bound: Bound) -> Bound:
    return 0 if isinstance(bound, float) else 1 / Fraction(bound)


def _multiply(left: Interval, right: Interval) -> Interval:
    products = [0 if a == 0 or b == 0 else a * b for a in left for b in right]
    return min(products), max(products)
