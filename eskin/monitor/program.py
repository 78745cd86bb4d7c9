"""Formulas as instructions, for engines that are compiled or run on a node."""

from __future__ import annotations

from enum import IntEnum
from fractions import Fraction
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from eskin.monitor.checks import Columns, comparison_of, sides
from eskin.monitor.formula import (
    Always,
    And,
    Atom,
    Channel,
    Comparison,
    Count,
    Eventually,
    Fall,
    Historically,
    Implies,
    Not,
    Once,
    Or,
    Reach,
    Rise,
    Since,
    Until,
    Window,
)

if TYPE_CHECKING:
    from collections.abc import Mapping

    from eskin.monitor.formula import Formula, Node


class Op(IntEnum):
    """Instructions; each takes its operands from a stack."""

    ATOM = 0
    NOT = 1
    AT_LEAST = 2
    FEWER = 3
    IMPLIES = 4
    ALWAYS = 5
    EVENTUALLY = 6
    HISTORICALLY = 7
    ONCE = 8
    UNTIL = 9
    SINCE = 10
    RISE = 11
    FALL = 12


_OPS: Final[dict[type[Node], Op]] = {
    Not: Op.NOT, And: Op.AT_LEAST, Or: Op.AT_LEAST, Implies: Op.IMPLIES, Always: Op.ALWAYS,
    Eventually: Op.EVENTUALLY, Historically: Op.HISTORICALLY, Once: Op.ONCE, Until: Op.UNTIL,
    Since: Op.SINCE, Rise: Op.RISE, Fall: Op.FALL,
}  # fmt: skip


class Instruction(NamedTuple):
    """A line of a program.

    Attributes:
        op: What it does.
        operands: How many it takes.
        first: Of a window, ns; of an atom, its number.
        last: Of a window, ns.
        number: How many operands must hold, of `Op.AT_LEAST`; fewer than that, of `Op.FEWER`.
    """

    op: int
    operands: int
    first: int
    last: int
    number: int


class Threshold(NamedTuple):
    """A comparison of a channel with a float.

    Attributes:
        channel: Its name.
        upward: Whether it is true of values that are not less; else of those not greater.
        value: The float, in the channel's unit.
    """

    channel: str
    upward: bool
    value: float


def instructions(formula: Formula, atoms: Mapping[Atom, int]) -> list[Instruction]:
    """The instructions of a formula with bounded windows, operands first.

    Args:
        formula: A formula that was checked.
        atoms: Number of each of its atoms.
    """
    if isinstance(formula, Atom):
        return [Instruction(int(Op.ATOM), 0, atoms[formula], 0, 0)]
    parts = formula.parts
    lines = [line for part in parts for line in instructions(part, atoms)]  # type: ignore[arg-type]  # formulas
    count, a, b, number = len(parts), 0, 0, 1
    if isinstance(formula, Count):
        upward = formula.comparison.upward
        strictly = formula.comparison in {Comparison.GREATER, Comparison.LESS_EQUAL}
        op, number = Op.AT_LEAST if upward else Op.FEWER, formula.number + strictly
    else:
        op = _OPS[type(formula)]
        number = count if isinstance(formula, And) else 1
    if isinstance(formula, Window | Reach):
        a, last = formula.bounds
        assert last is not None  # noqa: S101 - checked
        b = last
    return [*lines, Instruction(int(op), count, a, b, number)]


def threshold(atom: Atom, units: Mapping[str, str]) -> Threshold | None:
    """What an atom compares a channel with; ``None`` if it is no comparison with a constant.

    A constant that no float holds becomes the next one that is compared alike.
    """
    if any(delay for _, delay in atom.variables):
        return None
    left, right = atom.left, atom.right
    upward, strict = atom.comparison.upward, atom.comparison.strict
    one, other = (side.value for side in comparison_of(atom, Columns(), units))
    if isinstance(left, Channel) and isinstance(other, Fraction):
        channel, constant = left, other
    elif isinstance(right, Channel) and isinstance(one, Fraction):
        channel, constant, upward = right, one, not upward
    else:
        return None
    below, above = sides(constant)
    if upward:
        value = np.nextafter(below, np.inf) if strict else above
    else:
        value = np.nextafter(above, -np.inf) if strict else below
    return Threshold(channel.name, upward, float(value))
