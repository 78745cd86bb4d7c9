from __future__ import annotations

from contextlib import suppress
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from eskin.errors import MonitorError
from eskin.monitor import (
    Always,
    And,
    Constant,
    Eventually,
    Formula,
    Implies,
    Negate,
    Not,
    Or,
    Until,
    channel,
    parse,
)
from tests.unit.eskin.monitor.formulas import NAMES, atoms, bounds, constants, expressions, formulas

DRAWN = formulas(atoms(expressions(NAMES, constants())), bounds(10**13, unbounded=True))


@given(DRAWN)
def test_printed_formula_parses_to_the_same(formula: Formula) -> None:
    assert parse(str(formula)) == formula


def test_text_and_python_give_the_same_formula() -> None:
    pressure, velocity = channel("t07.pressure"), channel("joint.velocity")
    stops = Eventually((0, 20_000_000), velocity < 0.1)
    expected = Always((0, 50_000_000), Implies(pressure > Constant(3, "kPa"), stops))
    text = "always[0,50ms](t07.pressure > 3 kPa implies eventually[0,20ms](joint.velocity < 0.1))"
    assert parse(text) == expected


def test_a_decimal_is_exact_in_both_forms() -> None:
    value = channel("a") > 0.1
    assert value == parse("a > 0.1") == parse("a > 1e-1")
    assert isinstance(value.right, Constant)
    assert value.right.value == Fraction(1, 10)


def test_operators_bind_as_the_grammar_says() -> None:
    a, b, c = (channel(name) > 0 for name in "abc")
    assert parse("a > 0 or b > 0 and c > 0") == Or((a, And((b, c))))
    assert parse("not a > 0 and b > 0") == And((Not(a), b))
    assert parse("a > 0 implies b > 0 implies c > 0") == Implies(a, Implies(b, c))
    assert parse("a > 0 until[1ms,2ms] b > 0 and c > 0") == And(
        (Until((10**6, 2 * 10**6), a, b), c)
    )
    assert parse("always a > 0 and b > 0") == And((Always((0, None), a), b))
    x, y, z = map(channel, "xyz")
    assert parse("x - y - z * -x > 0") == (x - y - z * Negate(x) > 0)


@pytest.mark.parametrize("unit", ["and", "until/s", "a b", "", "m/", "3"])
def test_unit_is_a_code_that_a_text_can_have(unit: str) -> None:
    with pytest.raises(MonitorError):
        Constant(1, unit)


def test_first_bound_takes_the_unit_of_the_second() -> None:
    assert parse("always[10,50ms] a > 0") == Always((10**7, 5 * 10**7), channel("a") > 0)


@pytest.mark.parametrize(
    ("text", "column"),
    [
        ("", 1),
        ("a >", 4),
        ("a", 1),
        ("a > 1 > 2", 1),
        ("a > 1 $", 7),
        ("(a > 1", 7),
        ("a > 1)", 6),
        ("always[5ms,1ms] a > 1", 7),
        ("always[nan,1ms] a > 1", 8),
        ("always[1,2] a > 1", 8),
        ("always[0.5ns,1ns] a > 1", 8),
        ("always[-1ms,1ms] a > 1", 8),
        ("a > 1e99999", 5),
        ("and a > 1", 1),
        ("a > 1 until b > 1 until c > 1", 19),
        ("a and b > 1", 1),
        ("count(a > 1) >= 1.5", 17),
        ("count(a > 1, b) >= 1", 14),
        ('"" > 1', 2),
        ("\x1f", 1),  # a blank of Unicode, and none of the grammar
        ("a > \x1f 1", 5),
    ],
)
def test_fault_names_its_column(text: str, column: int) -> None:
    with pytest.raises(MonitorError) as caught:
        parse(text)
    assert caught.value.column == column


@pytest.mark.parametrize(
    ("text", "column", "value", "remedy"),
    [
        ("G(a > 1)", 1, "G", "always"),
        ("G[0,1s](a > 1)", 1, "G", "always"),
        ("a > 1 and sometimes(b > 1)", 11, "sometimes", "eventually"),
        ("always[50ms] a > 1", 12, "]", "[0,50ms]"),
        ("always[0,5] a > 1", 10, "5", "50ms"),
        ("a == 1", 3, "=", ">="),
        ("(a > 1) xor b > 1", 9, "xor", "implies"),
        ("a xor b", 3, "xor", "implies"),
        ("evetually a > 1", 11, "a", "until"),
        ("a > 1 && b > 1", 7, "&", "and"),
    ],
)
def test_fault_names_column_value_and_remedy(
    text: str, column: int, value: str, remedy: str
) -> None:
    with pytest.raises(MonitorError) as caught:
        parse(text)
    assert (caught.value.column, caught.value.value) == (column, value)
    assert remedy in caught.value.reason


@pytest.mark.parametrize(
    "text", ["not ", "(", "-", "always[0,1s] ", "a > 1 implies ", "rise(", "a+"]
)
def test_ten_thousand_nested_operators_are_refused(text: str) -> None:
    with pytest.raises(MonitorError):
        parse(text * 10_000 + "a > 1")


def test_deep_and_large_python_forms_are_refused() -> None:
    def nest(formula: Formula) -> None:
        for _ in range(10_000):
            formula = ~formula

    def double(formula: Formula) -> None:
        for _ in range(60):
            formula &= formula

    for build in (nest, double):
        with pytest.raises(MonitorError):
            build(channel("a") > 1)


@pytest.mark.parametrize(
    "value", [np.nan, np.inf, -np.inf, True, Fraction(1, 3), "3", None, 10**1000]
)
def test_constant_is_a_finite_decimal(value: object) -> None:
    with pytest.raises(MonitorError):
        Constant(value)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "window",
    [(2, 1), (-1, 2), (np.nan, 1), (0, np.nan), (0.5, 1), (0,), None, (0, 2**62), (True, 2)],
)
def test_window_is_a_pair_of_whole_ns(window: object) -> None:
    with pytest.raises(MonitorError):
        Always(window, channel("a") > 1)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "text",
    [
        'once[0,50ms] "palm/t01.energy" > 6 pJ and not (a > 1 until[0,1s] b < -2)',
        'outside(a, constant(value = [1 kPa, 2 kPa]), "2026-01-01T00:00:00Z") > 0',
        "count(a > 1, b > 2) >= 2 implies rise(min(a, delay(b, 10ms)) > max(a, 0.5))",
    ],
)
def test_text_that_breaks_off_anywhere_parses_or_is_refused(text: str) -> None:
    parse(text)
    for length in range(len(text)):
        with suppress(MonitorError):
            parse(text[:length])


@given(st.text(alphabet='ab(">=<-+*/[],.0123 notuilreshmv%', max_size=60))
def test_any_text_parses_or_is_refused(text: str) -> None:
    try:
        formula = parse(text)
    except MonitorError:
        return
    assert parse(str(formula)) == formula


def test_formula_is_no_boolean() -> None:
    with pytest.raises(MonitorError):
        bool(channel("a") > 1)
