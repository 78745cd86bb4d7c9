"""Formulas of the oracle, and how they are written.

None of it is shared with the library: only the text that :func:`write` gives reaches the parser.
Times are nanoseconds, values are in the unit of their channel.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from typing import TYPE_CHECKING, Final, Literal, TypeAlias

if TYPE_CHECKING:
    from collections.abc import Iterator

Rational: TypeAlias = int | Fraction
Comparison: TypeAlias = Literal["<", "<=", ">", ">="]
Windowed: TypeAlias = Literal["always", "eventually", "historically", "once"]
NEGATED: Final[dict[Comparison, Comparison]] = {"<": ">=", "<=": ">", ">": "<=", ">=": "<"}


@dataclass(frozen=True)
class Channel:
    name: str


@dataclass(frozen=True)
class Number:
    """A constant: its text in the formula, and its value in the channels' unit."""

    text: str
    value: Rational


@dataclass(frozen=True)
class Operation:
    """``+ - * /``, ``min``, ``max`` of two expressions; ``neg``, ``abs`` of one."""

    name: str
    operands: tuple[Expression, ...]


Expression: TypeAlias = Channel | Number | Operation


@dataclass(frozen=True)
class Window:
    """Closed, from ``begin`` to ``end`` in nanoseconds, as its text says.

    An end may be infinite.
    """

    begin: int
    end: float
    text: str


@dataclass(frozen=True)
class Atom:
    left: Expression
    comparison: Comparison
    right: Expression


@dataclass(frozen=True)
class Not:
    operand: Formula


@dataclass(frozen=True)
class Both:
    """``and``, ``or``, ``implies`` of two formulas."""

    name: Literal["and", "or", "implies"]
    left: Formula
    right: Formula


@dataclass(frozen=True)
class Within:
    """``always``, ``eventually``, ``historically`` or ``once``."""

    name: Windowed
    window: Window
    operand: Formula


@dataclass(frozen=True)
class Before:
    """``until`` or ``since``: ``right`` in the window, ``left`` up to it."""

    name: Literal["until", "since"]
    window: Window
    left: Formula
    right: Formula


@dataclass(frozen=True)
class Edge:
    """``rise`` or ``fall``."""

    name: Literal["rise", "fall"]
    operand: Formula


@dataclass(frozen=True)
class Count:
    """How many of several formulas hold, compared with a number."""

    operands: tuple[Formula, ...]
    comparison: Comparison
    number: int


Formula: TypeAlias = Atom | Not | Both | Within | Before | Edge | Count


def parts(formula: Formula) -> tuple[Formula, ...]:
    """What a formula is directly made of."""
    match formula:
        case Atom():
            return ()
        case Not(operand) | Within(_, _, operand) | Edge(_, operand):
            return (operand,)
        case Both(_, left, right) | Before(_, _, left, right):
            return left, right
        case Count(operands):
            return operands


def atoms(formula: Formula) -> Iterator[Atom]:
    if isinstance(formula, Atom):
        yield formula
    for part in parts(formula):
        yield from atoms(part)


def named(expression: Expression) -> Iterator[str]:
    """The channels of an expression, as often as each occurs."""
    match expression:
        case Channel(name):
            yield name
        case Operation(_, operands):
            for operand in operands:
                yield from named(operand)


def channels(formula: Formula) -> list[str]:
    """The channels of a formula, as often as each occurs."""
    return [n for a in atoms(formula) for side in (a.left, a.right) for n in named(side)]


def reach(formula: Formula) -> tuple[float, float]:
    """How far before and after its instant a formula looks, in nanoseconds."""
    inner = [reach(part) for part in parts(formula)]
    past = max((p for p, _ in inner), default=0.0)
    future = max((f for _, f in inner), default=0.0)
    match formula:
        case Within("always" | "eventually", window, _) | Before("until", window, _, _):
            return past, future + window.end
        case Within(_, window, _) | Before(_, window, _, _):
            return past + window.end, future
        case _:
            return past, future


def write(formula: Formula) -> str:
    """The formula as the library reads it, with all its parentheses."""
    match formula:
        case Atom(left, comparison, right):
            return f"{_write(left)} {comparison} {_write(right)}"
        case Not(operand):
            return f"not ({write(operand)})"
        case Both(name, left, right):
            return f"({write(left)}) {name} ({write(right)})"
        case Within(name, window, operand):
            return f"{name}{window.text}({write(operand)})"
        case Before(name, window, left, right):
            return f"({write(left)}) {name}{window.text} ({write(right)})"
        case Edge(name, operand):
            return f"{name}({write(operand)})"
        case Count(operands, comparison, number):
            return f"count({', '.join(map(write, operands))}) {comparison} {number}"


def _write(expression: Expression) -> str:
    match expression:
        case Channel(name):
            return name
        case Number(text, _):
            return text
        case Operation("neg", (operand,)):
            return f"-({_write(operand)})"
        case Operation("abs" | "min" | "max" as name, operands):
            return f"{name}({', '.join(map(_write, operands))})"
        case Operation(name, (left, right)):
            return f"({_write(left)}) {name} ({_write(right)})"
    raise AssertionError(expression)
