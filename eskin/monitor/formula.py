"""Formulas of signal temporal logic: what they are made of, and how they print.

A formula compares expressions over channels, and combines the comparisons in time. All parts are
frozen and hashable; `eskin.monitor.parse` reads ``str(formula)`` back.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field, fields
from decimal import Decimal
from enum import StrEnum
from fractions import Fraction
from typing import TYPE_CHECKING, Final, TypeAlias

import numpy as np

from eskin.errors import MonitorError, shown
from eskin.interval import require_plain

if TYPE_CHECKING:
    from collections.abc import Iterator

    from eskin.monitor.prediction import Prediction

MAX_DEPTH: Final = 100
"""Operators within operators; walks over a formula recurse this deep."""
MAX_SIZE: Final = 10_000
"""Parts of a formula, each counted as often as it occurs."""
MAX_BOUND: Final = 2**58
"""ns, nine years: the largest bound of a window, and the largest sum of nested ones."""

KEYWORDS: Final = frozenset(
    {
        "not", "and", "or", "implies", "always", "eventually", "historically", "once", "until",
        "since", "rise", "fall", "count", "abs", "min", "max", "inf", "delay", "outside",
    }
)  # fmt: skip
"""Words of the grammar; a channel with such a name stands in double quotes."""

Bounds: TypeAlias = "tuple[int, int | None]"
"""A closed window in whole ns after now (before now, of the past); ``None`` is unbounded."""

UNBOUNDED: Final[Bounds] = (0, None)
_NAME: Final = re.compile(r"[^\x00-\x1f\"]{1,200}")
_PLAIN_NAME: Final = re.compile(r"[A-Za-z_]\w*(?:\.\w+)*", re.ASCII)
UNIT: Final = (
    rf"(?!(?:{'|'.join(sorted(KEYWORDS - {'min'}))})\b)"
    r"(?:%|[A-Za-z]+(?:-?\d+)?)(?:[./](?:%|[A-Za-z]+(?:-?\d+)?))*"
)
"""Pattern of a UCUM code in a text, which is no word of the grammar but minutes; or it is ``1``."""
_UNIT: Final = re.compile(rf"{UNIT}|1", re.ASCII)
_LARGEST_EXPONENT: Final = 400


class Comparison(StrEnum):
    """How two values are compared."""

    GREATER = ">"
    GREATER_EQUAL = ">="
    LESS = "<"
    LESS_EQUAL = "<="

    @property
    def upward(self) -> bool:
        """Whether a greater value on the left makes it true."""
        return self in {Comparison.GREATER, Comparison.GREATER_EQUAL}

    @property
    def strict(self) -> bool:
        """Whether equal values make it false."""
        return self in {Comparison.GREATER, Comparison.LESS}


@dataclass(frozen=True, kw_only=True)
class Node:
    """A part of a formula.

    Attributes:
        column: Where it stands in the text that it was parsed from, from 1.
        parts: The operands.
        depth: How many parts lie within each other, at most.
        size: How many parts there are, itself among them.
    """

    column: int | None = field(default=None, compare=False, repr=False)
    parts: tuple[Node, ...] = field(init=False, compare=False, repr=False)
    depth: int = field(init=False, compare=False, repr=False)
    size: int = field(init=False, compare=False, repr=False)

    def __post_init__(self) -> None:
        values = [getattr(self, each.name) for each in fields(self) if each.init]
        spread = [part for v in values for part in (v if isinstance(v, tuple) else (v,))]
        parts = tuple(part for part in spread if isinstance(part, Node))
        depth = 1 + max((part.depth for part in parts), default=0)
        size = 1 + sum(part.size for part in parts)
        if depth > MAX_DEPTH:
            raise MonitorError(
                f"operators are nested deeper than {MAX_DEPTH}; split the formula in two",
                column=self.column,
                value=depth,
            )
        if size > MAX_SIZE:
            raise MonitorError(
                f"the formula has more than {MAX_SIZE} parts; split it in two",
                column=self.column,
                value=size,
            )
        object.__setattr__(self, "parts", parts)
        object.__setattr__(self, "depth", depth)
        object.__setattr__(self, "size", size)

    def walk(self) -> Iterator[Node]:
        """Itself and all parts in it, in the order of the text."""
        waiting: list[Node] = [self]
        while waiting:
            node = waiting.pop()
            yield node
            waiting.extend(reversed(node.parts))

    def __str__(self) -> str:
        return _text(self, 0)


@dataclass(frozen=True)
class Expression(Node):
    """A value over time. Operators and comparisons build expressions and formulas."""

    def __add__(self, other: Operand) -> Add:
        return Add(self, _expression(other))

    def __radd__(self, other: Operand) -> Add:
        return Add(_expression(other), self)

    def __sub__(self, other: Operand) -> Subtract:
        return Subtract(self, _expression(other))

    def __rsub__(self, other: Operand) -> Subtract:
        return Subtract(_expression(other), self)

    def __mul__(self, other: Operand) -> Multiply:
        return Multiply(self, _expression(other))

    def __rmul__(self, other: Operand) -> Multiply:
        return Multiply(_expression(other), self)

    def __truediv__(self, other: Operand) -> Divide:
        return Divide(self, _expression(other))

    def __rtruediv__(self, other: Operand) -> Divide:
        return Divide(_expression(other), self)

    def __neg__(self) -> Negate:
        return Negate(self)

    def __abs__(self) -> Absolute:
        return Absolute(self)

    def __gt__(self, other: Operand) -> Atom:
        return Atom(self, Comparison.GREATER, _expression(other))

    def __ge__(self, other: Operand) -> Atom:
        return Atom(self, Comparison.GREATER_EQUAL, _expression(other))

    def __lt__(self, other: Operand) -> Atom:
        return Atom(self, Comparison.LESS, _expression(other))

    def __le__(self, other: Operand) -> Atom:
        return Atom(self, Comparison.LESS_EQUAL, _expression(other))

    @property
    def channels(self) -> frozenset[str]:
        """Names of the channels in it."""
        return frozenset(node.name for node in self.walk() if isinstance(node, Channel))

    @property
    def variables(self) -> frozenset[Variable]:
        """The channels in it, each with its delay."""
        return frozenset(node.variable for node in self.walk() if isinstance(node, Channel))


Variable: TypeAlias = tuple[str, int]
"""Name of a channel, and how many ns ago it is read."""
Operand: TypeAlias = "Expression | int | float | Fraction | Decimal"


@dataclass(frozen=True)
class Channel(Expression):
    """A signal by its name, ``{taxel}.{quantity}``: any series of intervals, also of a count.

    Attributes:
        name: Its name.
        delay: How many ns ago it is read: ``delay(t07.pressure, 100ms)``.

    Raises:
        MonitorError: The name is empty, or has a quote or a control character in it; or the delay
            is negative or too long.
    """

    name: str
    delay: int = 0

    def __post_init__(self) -> None:
        name: object = self.name
        if not isinstance(name, str) or not _NAME.fullmatch(name):
            raise MonitorError(
                f"{shown(self.name)} is no channel's name; give 1 to 200 characters without quotes",
                column=self.column,
                value=self.name,
            )
        delay: object = self.delay
        if not isinstance(delay, int) or not 0 <= delay <= MAX_BOUND:
            raise MonitorError(
                f"a delay lies in [0, {MAX_BOUND}] ns, not {shown(self.delay)}",
                column=self.column,
                value=self.delay,
            )
        super().__post_init__()

    @property
    def variable(self) -> Variable:
        """Its name and its delay."""
        return self.name, self.delay


@dataclass(frozen=True)
class Deviation(Channel):
    """By how much a channel's samples lie outside of a prediction; negative where inside.

    It is a channel whose name is its text: ``outside(t07.pressure, constant(value = 3 kPa))``.

    Attributes:
        source: The channel that is measured.
        prediction: What a model predicts for it.

    Raises:
        MonitorError: As of `Channel`.
    """

    name: str = field(init=False)
    source: str = field(kw_only=True)
    prediction: Prediction = field(kw_only=True)

    def __post_init__(self) -> None:
        source = Channel(self.source, column=self.column)
        origin = f", {self.prediction.origin}" if self.prediction.origin else ""
        object.__setattr__(self, "name", f"outside({source}, {self.prediction}{origin})")
        Expression.__post_init__(self)


@dataclass(frozen=True)
class Constant(Expression):
    """A number in a unit.

    Attributes:
        value: The exact decimal number; a float is what it prints as, so 0.1 is 1/10.
        unit: UCUM code; ``None`` where it is that of the value beside it.

    Raises:
        MonitorError: It is no finite decimal number, or the unit is no UCUM code.
    """

    value: Fraction
    unit: str | None = None

    if TYPE_CHECKING:

        def __init__(
            self,
            value: Fraction | Decimal | float,
            unit: str | None = None,
            *,
            column: int | None = None,
        ) -> None: ...

    def __post_init__(self) -> None:
        object.__setattr__(self, "value", _decimal(self.value, self.column))
        if self.unit is not None and not _UNIT.fullmatch(self.unit):
            raise MonitorError(
                f"{shown(self.unit)} is no UCUM code; write such as kPa, m/s2 or 1",
                column=self.column,
                value=self.unit,
            )
        super().__post_init__()


@dataclass(frozen=True)
class _Unary(Expression):
    operand: Expression


@dataclass(frozen=True)
class _Binary(Expression):
    left: Expression
    right: Expression


class Negate(_Unary):
    """``-x``."""


class Absolute(_Unary):
    """``abs(x)``."""


class Add(_Binary):
    """``x + y``."""


class Subtract(_Binary):
    """``x - y``."""


class Multiply(_Binary):
    """``x * y``."""


class Divide(_Binary):
    """``x / y``; unknown where y may be 0."""


@dataclass(frozen=True)
class _Several(Expression):
    operands: tuple[Expression, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "operands", tuple(self.operands))
        _require_operands(self, self.operands, 1)
        super().__post_init__()


class Minimum(_Several):
    """``min(x, y, …)``."""


class Maximum(_Several):
    """``max(x, y, …)``."""


@dataclass(frozen=True)
class Formula(Node):
    """A statement about time: true or false at each instant. Combine with ``& | ~``."""

    def __and__(self, other: Formula) -> And:
        return And((self, other))

    def __or__(self, other: Formula) -> Or:
        return Or((self, other))

    def __invert__(self) -> Not:
        return Not(self)

    def __bool__(self) -> bool:
        raise MonitorError(
            "a formula is neither true nor false by itself; combine formulas with & | ~",
            value=str(self),
        )

    @property
    def channels(self) -> frozenset[str]:
        """Names of the channels in it, deviations among them."""
        return frozenset(node.name for node in self.walk() if isinstance(node, Channel))

    @property
    def sources(self) -> frozenset[str]:
        """Names of the channels that are measured."""
        nodes = [node for node in self.walk() if isinstance(node, Channel)]
        return frozenset(n.source if isinstance(n, Deviation) else n.name for n in nodes)

    @property
    def deviations(self) -> dict[str, Deviation]:
        """Its deviations by their names."""
        return {node.name: node for node in self.walk() if isinstance(node, Deviation)}

    @property
    def variables(self) -> frozenset[Variable]:
        """The channels in it, each with its delay."""
        return frozenset(node.variable for node in self.walk() if isinstance(node, Channel))


@dataclass(frozen=True)
class Atom(Formula):
    """A comparison of two expressions."""

    left: Expression
    comparison: Comparison
    right: Expression

    def __post_init__(self) -> None:
        object.__setattr__(self, "comparison", Comparison(self.comparison))
        super().__post_init__()


@dataclass(frozen=True)
class Not(Formula):
    """``not φ``."""

    operand: Formula


@dataclass(frozen=True)
class _Joined(Formula):
    operands: tuple[Formula, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "operands", tuple(self.operands))
        _require_operands(self, self.operands, 2)
        super().__post_init__()


class And(_Joined):
    """``φ and ψ and …``."""


class Or(_Joined):
    """``φ or ψ or …``."""


@dataclass(frozen=True)
class Implies(Formula):
    """``φ implies ψ``: ``not φ or ψ``."""

    left: Formula
    right: Formula


@dataclass(frozen=True)
class Window(Formula):
    """An operator over one operand in a closed window."""

    bounds: Bounds
    operand: Formula

    def __post_init__(self) -> None:
        object.__setattr__(self, "bounds", _whole_bounds(self.bounds, self.column))
        super().__post_init__()


class Always(Window):
    """``always[a,b] φ``: φ at each instant of [t + a, t + b]."""


class Eventually(Window):
    """``eventually[a,b] φ``: φ at some instant of [t + a, t + b]."""


class Historically(Window):
    """``historically[a,b] φ``: φ at each instant of [t - b, t - a]."""


class Once(Window):
    """``once[a,b] φ``: φ at some instant of [t - b, t - a]."""


@dataclass(frozen=True)
class Reach(Formula):
    """An operator with one operand that holds until, or since, another."""

    bounds: Bounds
    left: Formula
    right: Formula

    def __post_init__(self) -> None:
        object.__setattr__(self, "bounds", _whole_bounds(self.bounds, self.column))
        super().__post_init__()


class Until(Reach):
    """``φ until[a,b] ψ``: ψ at some t' of [t + a, t + b], and φ on [t, t')."""


class Since(Reach):
    """``φ since[a,b] ψ``: ψ at some t' of [t - b, t - a], and φ on (t', t]."""


@dataclass(frozen=True)
class _Edge(Formula):
    operand: Formula


class Rise(_Edge):
    """``rise(φ)``: φ holds at t, and did not hold just before (on some (t - ε, t))."""


class Fall(_Edge):
    """``fall(φ)``: φ does not hold at t, and did hold just before."""


@dataclass(frozen=True)
class Count(Formula):
    """``count(φ, ψ, …) >= n``: how many of the operands hold at t.

    Raises:
        MonitorError: The number is no whole one.
    """

    operands: tuple[Formula, ...]
    comparison: Comparison
    number: int

    def __post_init__(self) -> None:
        object.__setattr__(self, "operands", tuple(self.operands))
        object.__setattr__(self, "comparison", Comparison(self.comparison))
        _require_operands(self, self.operands, 1)
        if type(self.number) is not int or not 0 <= self.number <= MAX_SIZE:
            raise MonitorError(
                f"a count is compared with a whole number up to {MAX_SIZE}, not "
                f"{shown(self.number)}",
                column=self.column,
                value=self.number,
            )
        super().__post_init__()


def channel(name: str, delay: int = 0) -> Channel:
    """A channel, whose comparisons are formulas: ``channel("t07.pressure") > 3000``."""
    return Channel(name, delay)


def _expression(value: Operand) -> Expression:
    if isinstance(value, Expression):
        return value
    return Constant(value)


def _require_operands(node: Node, operands: tuple[Node, ...], least: int) -> None:
    if len(operands) < least:
        raise MonitorError(
            f"{type(node).__name__} needs {least} operands at least, not {len(operands)}",
            column=node.column,
            value=len(operands),
        )


def _decimal(value: object, column: int | None) -> Fraction:
    """The exact number, which must have a finite decimal form of bounded length."""
    require_plain(value, "a constant", MonitorError)
    if isinstance(value, np.generic):
        value = value.item()
    exact: Fraction | None = None
    if isinstance(value, float):
        value = Decimal(repr(value))
    if isinstance(value, Decimal):
        if value.is_finite() and abs(value.adjusted()) <= _LARGEST_EXPONENT:
            exact = Fraction(value)
    elif isinstance(value, int | Fraction) and not isinstance(value, bool):
        exact = Fraction(value)
    if exact is None or exact.numerator.bit_length() > 4 * _LARGEST_EXPONENT:
        raise MonitorError(
            f"{shown(value)} is no number that a constant can have; give a finite one of "
            f"{_LARGEST_EXPONENT} digits at most",
            column=column,
            value=value,
        )
    if _places(exact) is None:
        raise MonitorError(
            f"{shown(value)} has no finite decimal form; write it as a quotient of two constants",
            column=column,
            value=value,
        )
    return exact


def _places(value: Fraction) -> int | None:
    """Decimal places that write a number exactly; ``None`` where none do."""
    rest, twos, fives = value.denominator, 0, 0
    if rest.bit_length() > 12 * _LARGEST_EXPONENT:
        return None
    while rest % 2 == 0:
        rest, twos = rest // 2, twos + 1
    while rest % 5 == 0:
        rest, fives = rest // 5, fives + 1
    return max(twos, fives) if rest == 1 else None


def _whole_bounds(bounds: object, column: int | None) -> Bounds:
    """Bounds of a window, checked."""

    def fault(reason: str) -> MonitorError:
        return MonitorError(f"the window {shown(bounds)} {reason}", column=column, value=bounds)

    if not isinstance(bounds, tuple | list) or len(bounds) != 2:
        raise fault("is no pair of bounds; give (a, b) in ns, b None if it is unbounded")
    first, last = bounds
    for each in bounds:
        if isinstance(each, float) and math.isnan(each):
            raise fault("has a bound that is NaN; give whole ns")
    if not isinstance(first, int | np.integer) or isinstance(first, bool):
        raise fault("must begin with a whole number of ns")
    if last is not None and (not isinstance(last, int | np.integer) or isinstance(last, bool)):
        raise fault("must end with a whole number of ns, or None")
    if first < 0:
        raise fault("has a negative bound; use once or historically for the past")
    if last is not None and first > last:
        raise fault("is reversed: a > b; exchange its bounds")
    if first > MAX_BOUND or (last is not None and last > MAX_BOUND):
        raise fault(f"reaches beyond {MAX_BOUND} ns; shorten it, or leave it unbounded")
    return int(first), None if last is None else int(last)


IMPLIES, OR, AND, REACH, PREFIX, COMPARE, SUM, PRODUCT, SIGN, WHOLE = range(1, 11)
"""How strongly operators bind, the weakest first."""

_INFIX: Final[dict[type[Node], tuple[str, int]]] = {
    Add: ("+", SUM),
    Subtract: ("-", SUM),
    Multiply: ("*", PRODUCT),
    Divide: ("/", PRODUCT),
}
_CALLS: Final[dict[type[Node], str]] = {
    Absolute: "abs",
    Minimum: "min",
    Maximum: "max",
    Rise: "rise",
    Fall: "fall",
}
WINDOWS: Final[dict[str, type[Window]]] = {
    "always": Always,
    "eventually": Eventually,
    "historically": Historically,
    "once": Once,
}
"""Operators over a window by their words."""
REACHES: Final[dict[str, type[Reach]]] = {"until": Until, "since": Since}
"""Operators with two operands over a window by their words."""


def _text(node: Node, binding: int) -> str:
    """A node as text, in parentheses where its operator binds less than what is around it."""
    text, own = _written(node)
    return text if own >= binding else f"({text})"


def _written(node: Node) -> tuple[str, int]:  # noqa: C901, PLR0911, PLR0912 - a line for each kind of node
    kind = type(node)
    if isinstance(node, Deviation):
        return node.name, WHOLE
    if isinstance(node, Channel):
        plain = _PLAIN_NAME.fullmatch(node.name) and node.name not in KEYWORDS
        name = node.name if plain else f'"{node.name}"'
        return f"delay({name}, {time_text(node.delay)})" if node.delay else name, WHOLE
    if isinstance(node, Constant):
        unit = "" if node.unit is None else f" {node.unit}"
        return f"{number_text(node.value)}{unit}", SIGN if node.value < 0 else WHOLE
    if isinstance(node, Negate):
        # A sign before a number is part of the number, so here is a parenthesis.
        inner = _text(node.operand, WHOLE)
        return f"-({inner})" if isinstance(node.operand, Constant) else f"-{inner}", SIGN
    if isinstance(node, _Binary):
        sign, own = _INFIX[kind]
        return f"{_text(node.left, own)} {sign} {_text(node.right, own + 1)}", own
    if kind in _CALLS:
        return f"{_CALLS[kind]}({', '.join(map(str, node.parts))})", WHOLE
    if isinstance(node, Atom):
        sides = _text(node.left, SUM), _text(node.right, SUM)
        return f"{sides[0]} {node.comparison} {sides[1]}", COMPARE
    if isinstance(node, Not):
        return f"not {_text(node.operand, PREFIX)}", PREFIX
    if isinstance(node, _Joined):
        word, own = ("and", AND) if isinstance(node, And) else ("or", OR)
        return f" {word} ".join(_text(each, own + 1) for each in node.operands), own
    if isinstance(node, Implies):
        return f"{_text(node.left, OR)} implies {_text(node.right, IMPLIES)}", IMPLIES
    if isinstance(node, Window):
        operator = kind.__name__.lower() + bounds_text(node.bounds)
        return f"{operator} {_text(node.operand, PREFIX)}", PREFIX
    if isinstance(node, Reach):
        operator = kind.__name__.lower() + bounds_text(node.bounds)
        return f"{_text(node.left, PREFIX)} {operator} {_text(node.right, PREFIX)}", REACH
    if isinstance(node, Count):
        operands = ", ".join(map(str, node.operands))
        return f"count({operands}) {node.comparison} {node.number}", COMPARE
    raise MonitorError(f"{kind.__name__} is no part of a formula")


def number_text(value: Fraction) -> str:
    """An exact decimal number as text."""
    places = _places(value) or 0
    digits = value.numerator * 10**places // value.denominator
    if places == 0 and abs(digits) < 10**15:
        return str(digits)
    exponent = -places
    while digits and digits % 10 == 0:
        digits, exponent = digits // 10, exponent + 1
    sign, figures = (1, -digits) if digits < 0 else (0, digits)
    return str(Decimal((sign, tuple(map(int, str(figures))), exponent)))


_TIMES: Final = {"h": 3600 * 10**9, "min": 60 * 10**9, "s": 10**9, "ms": 10**6, "us": 10**3}


def bounds_text(bounds: Bounds) -> str:
    """A window as text, such as ``[0,50ms]``; nothing where it is all the future or the past."""
    if bounds == UNBOUNDED:
        return ""
    first, last = bounds
    return f"[{time_text(first)},{'inf)' if last is None else time_text(last) + ']'}"


def time_text(time: int) -> str:
    """A length of time in the longest unit of which it is a whole number."""
    if time == 0:
        return "0"
    for unit, length in _TIMES.items():
        if time % length == 0:
            return f"{time // length}{unit}"
    return f"{time}ns"
