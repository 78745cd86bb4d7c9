"""In which direction each channel of a formula works."""

from __future__ import annotations

from typing import TYPE_CHECKING

from tests.unit.eskin.monitor.oracle.formulas import (
    Atom,
    Before,
    Both,
    Channel,
    Count,
    Edge,
    Expression,
    Formula,
    Not,
    Number,
    Operation,
    Within,
    named,
)
from tests.unit.eskin.monitor.oracle.intervals import value

if TYPE_CHECKING:
    from collections.abc import Iterator


def directions(formula: Formula) -> dict[str, int] | None:
    """For each channel, 1 if greater values can only help a formula to hold, -1 if lesser ones can.

    None if a channel has no direction, or two. Then the formula's extreme worlds are unknown.
    """
    found = signs(formula)
    return None if 0 in found.values() else found


def signs(formula: Formula) -> dict[str, int]:
    """The same, and 0 for a channel that has no direction, or two."""
    found: dict[str, int] = {}
    for name, sign in _of_formula(formula, 1):
        if found.setdefault(name, sign) != sign:
            found[name] = 0
    return found


def _of_formula(formula: Formula, sign: int) -> Iterator[tuple[str, int]]:
    match formula:
        case Atom(left, comparison, right):
            up = sign if comparison in {">", ">="} else -sign
            yield from _of_expression(left, up)
            yield from _of_expression(right, -up)
        case Not(operand):
            yield from _of_formula(operand, -sign)
        case Both(name, left, right):
            yield from _of_formula(left, -sign if name == "implies" else sign)
            yield from _of_formula(right, sign)
        case Within(_, _, operand):
            yield from _of_formula(operand, sign)
        case Before(_, _, left, right):
            yield from _of_formula(left, sign)
            yield from _of_formula(right, sign)
        case Edge(_, operand):
            yield from _of_formula(operand, 0)
        case Count(operands, comparison, _):
            for operand in operands:
                yield from _of_formula(operand, sign if comparison in {">", ">="} else -sign)


def _of_expression(expression: Expression, sign: int) -> Iterator[tuple[str, int]]:
    match expression:
        case Channel(name):
            yield name, sign
        case Number():
            return
        case Operation("neg", (operand,)):
            yield from _of_expression(operand, -sign)
        case Operation("abs", (operand,)):
            yield from _of_expression(operand, 0)
        case Operation("-", (left, right)):
            yield from _of_expression(left, sign)
            yield from _of_expression(right, -sign)
        case Operation("*" | "/" as name, (left, right)):
            yield from _of_expression(left, sign * _sign(right))
            yield from _of_expression(right, sign * _sign(left) if name == "*" else 0)
        case Operation(_, operands):
            for operand in operands:
                yield from _of_expression(operand, sign)


def _sign(expression: Expression) -> int:
    """1 or -1 for a constant that is not zero, and 0 for anything else."""
    if next(named(expression), None) is not None:
        return 0
    number = value(expression, {})
    return (number > 0) - (number < 0)
