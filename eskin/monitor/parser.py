"""Read a formula from its text.

A Pratt parser. Operators from the weakest to the strongest::

    implies                                   (right to left)
    or
    and
    until[a,b]   since[a,b]                   (not chained: use parentheses)
    not   always[a,b]   eventually[a,b]   historically[a,b]   once[a,b]
    >   >=   <   <=                           (not chained)
    +   -
    *   /
    -x

Besides there are ``rise(φ)``, ``fall(φ)``, ``count(φ, ψ, …) >= n``, ``abs(x)``, ``min(x, y, …)``,
``max(x, y, …)``, ``delay(p, 100ms)`` and ``outside(p, model(parameter = [lo, hi], …), time)``. A
window without bounds is all the future, or all the past. A number may have a UCUM code, written
without blanks (``3 kPa``, ``2 m/s``); times have ``ns us ms s min h d``.
"""

from __future__ import annotations

import re
from fractions import Fraction
from typing import TYPE_CHECKING, Final, NamedTuple, TypeVar

from eskin.errors import MonitorError, shown
from eskin.monitor.formula import (
    AND,
    COMPARE,
    IMPLIES,
    KEYWORDS,
    MAX_DEPTH,
    OR,
    PREFIX,
    PRODUCT,
    REACH,
    REACHES,
    SIGN,
    SUM,
    UNBOUNDED,
    UNIT,
    WINDOWS,
    Absolute,
    Add,
    And,
    Atom,
    Bounds,
    Channel,
    Comparison,
    Constant,
    Count,
    Deviation,
    Divide,
    Expression,
    Fall,
    Formula,
    Implies,
    Maximum,
    Minimum,
    Multiply,
    Negate,
    Node,
    Not,
    Or,
    Rise,
    Subtract,
)
from eskin.monitor.prediction import Prediction, PredictionParameter
from eskin.wire.timestamp import parse_timestamp

if TYPE_CHECKING:
    from collections.abc import Callable

MAX_LENGTH: Final = 2**17
"""Characters of a text."""

_TOKEN: Final = re.compile(
    rf"""\s*(?:
        (?P<number>(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)
            (?:\s*(?P<unit>{UNIT})|\s+(?P<one>1)(?![\w.]))?
        | (?P<word>[A-Za-z_]\w*(?:\.\w+)*)
        | "(?P<quoted>[^"]*)"
        | (?P<sign>>=|<=|[-+*/<>()\[\],=])
        | (?P<end>$)
    )""",
    re.VERBOSE | re.ASCII,
)
_BLANKS: Final = " \t\n\r\f\v"
"""What may stand between tokens; not all that Python strips."""
_NANOSECONDS: Final = {
    "ns": 1,
    "us": 10**3,
    "ms": 10**6,
    "s": 10**9,
    "min": 60 * 10**9,
    "h": 3600 * 10**9,
    "d": 86400 * 10**9,
}
_MAX_DIGITS: Final = 400

_Made = TypeVar("_Made", bound=Node)


class _Token(NamedTuple):
    kind: str
    text: str
    column: int
    unit: str | None = None


def parse(text: str) -> Formula:
    """Read a formula.

    Args:
        text: Such as ``always[0,50ms](t07.pressure > 3 kPa implies eventually[0,20ms] x.v < 1)``.

    Raises:
        MonitorError: It is no formula; the error has the column.
    """
    if not isinstance(text, str):
        raise MonitorError(f"a formula is a text, not {type(text).__name__}", value=text)
    if len(text) > MAX_LENGTH:
        raise MonitorError(
            f"the text has {len(text)} characters; {MAX_LENGTH} are allowed", value=len(text)
        )
    return _Parser(_tokens(text)).formula()


def _tokens(text: str) -> list[_Token]:
    found: list[_Token] = []
    place = 0
    while True:
        match = _TOKEN.match(text, place)
        if match is None:
            at = place + len(text[place:]) - len(text[place:].lstrip(_BLANKS))
            raise MonitorError(
                f"{shown(text[at])} has no meaning here; operators: {_OPERATORS} not",
                column=at + 1,
                value=text[at],
            )
        kind = next(k for k in ("number", "word", "quoted", "sign", "end") if match[k] is not None)
        found.append(
            _Token(kind, match[kind], match.start(kind) + 1, match["unit"] or match["one"])
        )
        place = match.end()
        if kind == "end":
            return found


_COMPARISONS: Final = frozenset(Comparison)
_INFIX: Final = {
    "implies": IMPLIES,
    "or": OR,
    "and": AND,
    "until": REACH,
    "since": REACH,
    "+": SUM,
    "-": SUM,
    "*": PRODUCT,
    "/": PRODUCT,
} | dict.fromkeys(_COMPARISONS, COMPARE)
_OPERATORS: Final = " ".join([*Comparison, "+", "-", "*", "/", *(w for w in _INFIX if w.isalpha())])
"""Between two parts."""
_CLOSING: Final = frozenset({")", "]", ","})
_BEFORE: Final = sorted(KEYWORDS - _INFIX.keys() - {"inf"})
"""Words that may stand before a parenthesis."""
_SUMS: Final[dict[str, type[Add | Subtract | Multiply | Divide]]] = {
    "+": Add,
    "-": Subtract,
    "*": Multiply,
    "/": Divide,
}


class _Parser:
    """Reads tokens one after the other."""

    def __init__(self, tokens: list[_Token]) -> None:
        self._tokens = tokens
        self._next = 0
        self._depth = 0

    def formula(self) -> Formula:
        found = self._formula(0)
        self._expect("")
        return found

    def _peek(self) -> _Token:
        return self._tokens[self._next]

    def _take(self) -> _Token:
        token = self._tokens[self._next]
        self._next += token.kind != "end"
        return token

    def _is(self, text: str) -> bool:
        token = self._peek()
        return token.kind in {"word", "sign"} and token.text == text

    def _expect(self, text: str) -> None:
        token = self._peek()
        if (token.kind == "end") if not text else self._is(text):
            self._next += bool(text)
            return
        found = "the end" if token.kind == "end" else shown(token.text)
        wanted = f"{text!r}" if text else f"an operator ({_OPERATORS}) or the end"
        raise MonitorError(f"expected {wanted}, not {found}", column=token.column, value=token.text)

    def _make(self, make: Callable[..., _Made], column: int, *parts: object) -> _Made:
        return make(*parts, column=column)

    def _formula(self, binding: int) -> Formula:
        column = self._peek().column
        found = self._parse(binding)
        if isinstance(found, Formula):
            return found
        token = self._peek()
        if token.kind != "end" and token.text not in _CLOSING:
            self._expect("")  # no value ends here: what comes is no operator
        raise MonitorError(
            f"{found} is a value, where a statement is needed; compare it: {found} > 0",
            column=column,
            value=str(found),
        )

    def _expression(self, binding: int) -> Expression:
        column = self._peek().column
        found = self._parse(binding)
        if isinstance(found, Expression):
            return found
        raise MonitorError(
            f"{found} is a statement, where a value is needed; comparisons do not chain: "
            "join two with 'and'",
            column=column,
            value=str(found),
        )

    def _parse(self, binding: int) -> Node:
        """A part whose operators bind at least so strongly."""
        self._depth += 1
        if self._depth > 2 * MAX_DEPTH:
            raise MonitorError(
                f"operators are nested deeper than {MAX_DEPTH}; split the formula in two",
                column=self._peek().column,
                value=self._depth,
            )
        start = self._peek().column
        found = self._prefix()
        while True:
            token = self._peek()
            own = _INFIX.get(token.text, 0) if token.kind in {"word", "sign"} else 0
            if own == 0 or own < binding:
                break
            found = self._infix(found, start, own)
        self._depth -= 1
        return found

    def _infix(self, left: Node, start: int, own: int) -> Node:
        token = self._take()
        word, column = token.text, token.column
        if own >= COMPARE:
            if not isinstance(left, Expression):
                raise MonitorError(
                    f"{word!r} needs a value on its left, not the statement {left}; comparisons do "
                    "not chain: join two with 'and'",
                    column=start,
                    value=str(left),
                )
            if own == COMPARE:
                return self._make(Atom, start, left, Comparison(word), self._expression(SUM))
            return self._make(_SUMS[word], column, left, self._expression(own + 1))
        if not isinstance(left, Formula):
            raise MonitorError(
                f"{word!r} needs a statement on its left, not the value {left}; compare it",
                column=start,
                value=str(left),
            )
        if word == "implies":
            return self._make(Implies, column, left, self._formula(IMPLIES))
        if own == REACH:
            bounds = self._bounds()
            found = self._make(REACHES[word], column, bounds, left, self._formula(PREFIX))
            after = self._peek()
            if after.kind == "word" and after.text in REACHES:
                raise MonitorError(
                    f"{after.text!r} does not chain; put the first one in parentheses",
                    column=after.column,
                    value=after.text,
                )
            return found
        operands = [left, self._formula(own + 1)]
        while self._is(word):
            self._take()
            operands.append(self._formula(own + 1))
        return self._make(And if word == "and" else Or, column, tuple(operands))

    def _prefix(self) -> Node:  # noqa: PLR0911 - a line for each kind of token
        token = self._take()
        if token.kind == "number":
            return self._constant(token, 1)
        if token.kind == "quoted":
            return self._make(Channel, token.column, token.text)
        if token.kind == "word":
            if token.text in KEYWORDS:
                return self._keyword(token)
            if self._is("(") or self._is("["):
                known = _BEFORE if self._is("(") else WINDOWS
                raise MonitorError(
                    f"{shown(token.text)} is no operator; before {self._peek().text!r} stands one "
                    f"of {', '.join(known)}",
                    column=token.column,
                    value=token.text,
                )
            return self._make(Channel, token.column, token.text)
        if token.text == "(":
            found = self._parse(0)
            self._expect(")")
            return found
        if token.text == "-":
            number = self._peek()
            if number.kind == "number":
                return self._constant(self._take(), -1)
            return self._make(Negate, token.column, self._expression(SIGN))
        found_text = "the end" if token.kind == "end" else shown(token.text)
        raise MonitorError(
            f"expected a channel, a number or an operator, not {found_text}",
            column=token.column,
            value=token.text,
        )

    def _keyword(self, token: _Token) -> Node:  # noqa: PLR0911 - a line for each keyword
        word, column = token.text, token.column
        if word == "not":
            return self._make(Not, column, self._formula(PREFIX))
        if word in WINDOWS:
            bounds = self._bounds()
            return self._make(WINDOWS[word], column, bounds, self._formula(PREFIX))
        if word in {"rise", "fall"}:
            self._expect("(")
            operand = self._formula(0)
            self._expect(")")
            return self._make(Rise if word == "rise" else Fall, column, operand)
        if word == "abs":
            self._expect("(")
            value = self._expression(0)
            self._expect(")")
            return self._make(Absolute, column, value)
        if word == "delay":
            return self._delayed(column)
        if word == "outside":
            return self._outside(column)
        if word in {"min", "max"}:
            kind = Minimum if word == "min" else Maximum
            return self._make(kind, column, self._list(self._expression))
        if word == "count":
            return self._count(column)
        raise MonitorError(
            f"{word!r} needs something on its left; a channel of this name stands in double quotes",
            column=column,
            value=word,
        )

    def _delayed(self, column: int) -> Channel:
        self._expect("(")
        token = self._take()
        if token.kind != "quoted" and (token.kind != "word" or token.text in KEYWORDS):
            raise MonitorError(
                f"delay takes a channel and a time, as in delay(p, 100ms), not {shown(token.text)}",
                column=token.column,
                value=token.text,
            )
        self._expect(",")
        delay = _nanoseconds(self._time())
        self._expect(")")
        return self._make(Channel, column, token.text, delay)

    def _outside(self, column: int) -> Deviation:
        self._expect("(")
        source = self._take()
        if source.kind != "quoted" and (source.kind != "word" or source.text in KEYWORDS):
            raise MonitorError(
                "outside takes a channel and a prediction, as in "
                f"outside(p, constant(value = [1 kPa, 2 kPa])), not {shown(source.text)}",
                column=source.column,
                value=source.text,
            )
        self._expect(",")
        quantity = self._take()
        self._expect("(")
        parameters: list[PredictionParameter] = []
        while not self._is(")"):
            if parameters:
                self._expect(",")
            parameters.append(self._parameter())
        self._expect(")")
        origin = 0
        if self._is(","):
            self._take()
            origin = self._instant()
        self._expect(")")
        try:
            prediction = Prediction(quantity.text, tuple(parameters), origin)
        except MonitorError as error:
            raise MonitorError(error.reason, column=quantity.column, value=error.value) from error
        return Deviation(source=source.text, prediction=prediction, column=column)

    def _parameter(self) -> PredictionParameter:
        name = self._take()
        self._expect("=")
        if not self._is("["):
            value, unit = self._bound()
            return PredictionParameter(name.text, value, value, unit)
        self._take()
        lo, own = self._bound()
        self._expect(",")
        hi, unit = self._bound()
        self._expect("]")
        if own is not None and own != unit:
            raise MonitorError(
                f"the bounds of {shown(name.text)} have different units; give both in one",
                column=name.column,
                value=name.text,
            )
        return PredictionParameter(name.text, lo, hi, unit)

    def _bound(self) -> tuple[Fraction, str | None]:
        sign = -1 if self._is("-") else 1
        if sign < 0:
            self._take()
        token = self._peek()
        if token.kind != "number":
            raise MonitorError(
                f"expected a number, not {shown(token.text) if token.text else 'the end'}",
                column=token.column,
                value=token.text,
            )
        self._take()
        return sign * _number(token), token.unit

    def _instant(self) -> int:
        """The model's time 0: RFC 3339 in quotes, or ns since 1970."""
        token = self._peek()
        if token.kind == "quoted":
            self._take()
            try:
                return parse_timestamp(token.text)
            except ValueError as error:
                raise MonitorError(str(error), column=token.column, value=token.text) from error
        value, unit = self._bound()
        if unit is not None or value.denominator != 1 or abs(value) >= 2**63:
            raise MonitorError(
                'the time 0 of a model is RFC 3339 in quotes, such as "2026-01-31T12:00:00Z", or '
                "whole ns since 1970",
                column=token.column,
                value=token.text,
            )
        return int(value)

    def _list(self, read: Callable[[int], _Made]) -> tuple[_Made, ...]:
        self._expect("(")
        found = [read(0)]
        while self._is(","):
            self._take()
            found.append(read(0))
        self._expect(")")
        return tuple(found)

    def _count(self, column: int) -> Count:
        operands = self._list(self._formula)
        sign, number = self._take(), self._peek()
        if sign.kind != "sign" or sign.text not in _COMPARISONS:
            raise MonitorError(
                "a count is compared with a whole number: count(…) >= 2",
                column=sign.column,
                value=sign.text,
            )
        if number.kind != "number" or number.unit is not None or not number.text.isdigit():
            raise MonitorError(
                f"a count is compared with a whole number, not {shown(number.text)}",
                column=number.column,
                value=number.text,
            )
        self._take()
        value = int(number.text) if len(number.text) < 10 else 10**9
        return self._make(Count, column, operands, Comparison(sign.text), value)

    def _constant(self, token: _Token, sign: int) -> Constant:
        return self._make(Constant, token.column, sign * _number(token), token.unit)

    def _bounds(self) -> Bounds:
        if not self._is("["):
            return UNBOUNDED
        column = self._take().column
        first = self._time()
        self._require_two_bounds()
        if self._is("inf"):
            self._take()
            last = None
            self._expect(")" if self._is(")") else "]")
        else:
            last = self._time()
            self._expect("]")
        return self._window(first, last, column)

    def _require_two_bounds(self) -> None:
        token = self._peek()
        if token.text == "]":
            raise MonitorError(
                "a window has two bounds, as in [0,50ms]; the last one is missing",
                column=token.column,
                value=token.text,
            )
        self._expect(",")

    def _time(self) -> _Token:
        token = self._take()
        if token.kind != "number":
            found = "the end" if token.kind == "end" else shown(token.text)
            raise MonitorError(
                f"a window's bound is a time such as 50ms, not {found}",
                column=token.column,
                value=token.text,
            )
        return token

    def _window(self, first: _Token, last: _Token | None, column: int) -> Bounds:
        """The bounds in ns; the first one may leave its unit to the last."""
        unit = first.unit or (last.unit if last is not None else None)
        a = _nanoseconds(first._replace(unit=unit))
        b = None if last is None else _nanoseconds(last)
        if b is not None and a > b:
            raise MonitorError(
                f"the window [{a} ns, {b} ns] is reversed: a > b; exchange its bounds",
                column=column,
                value=(a, b),
            )
        return a, b


def _number(token: _Token) -> Fraction:
    mantissa, _, exponent = token.text.lower().partition("e")
    if len(mantissa) > _MAX_DIGITS or len(exponent) > 4 or abs(int(exponent or 0)) > _MAX_DIGITS:
        raise MonitorError(
            f"{shown(token.text)} has more than {_MAX_DIGITS} digits; shorten it",
            column=token.column,
            value=token.text,
        )
    return Fraction(token.text)


def _nanoseconds(token: _Token) -> int:
    number = _number(token)
    if token.unit is None and number == 0:
        return 0
    if token.unit not in _NANOSECONDS:
        raise MonitorError(
            f"a window's bound needs a unit of time ({', '.join(_NANOSECONDS)}), as in 50ms, not "
            f"{shown(token.unit or token.text)}",
            column=token.column,
            value=token.unit or token.text,
        )
    time = number * _NANOSECONDS[token.unit]
    if time.denominator != 1:
        raise MonitorError(
            f"{token.text} {token.unit} is no whole number of ns; round it",
            column=token.column,
            value=token.text,
        )
    return int(time)
