from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

from eskin.errors import MonitorError
from eskin.interval import Verdict
from eskin.monitor import Signal, check, evaluate, horizon, is_exact, parse
from eskin.monitor.units import known_unit

UNITS = {
    "p": "Pa", "q": "Pa", "k": "kPa", "v": "m/s", "x": "m", "t": "s", "n": "1", "h": "%",
    "T": "Cel",     "K": "K", "odd": "{taps}",
}  # fmt: skip


@pytest.mark.parametrize(
    "text",
    [
        "p > 3 kPa",
        "p + k > 3",
        "min(p, k, 2 kPa) > 1 bar",
        "x / t > 2 m/s",
        "x / t > v",
        "v * t > 2 km",
        "h > 40",
        "h > 40 % and n < 0.4 and h * 2 > n",
        "T > 30 and T > 300 K and T > K",
        "T - T < 1 K",
        "T + 3 K > 300 K",
        "odd > 3",
        "1 / t > 3 Hz",
        "abs(p - q) > 2 hPa",
        "2 * p > 3 kN/m2",
    ],
)
def test_units_that_fit_pass(text: str) -> None:
    check(parse(text), UNITS)


@pytest.mark.parametrize(
    ("text", "column"),
    [
        ("p > 3 m", 1),
        ("p > 1 and p > 3 m", 11),
        ("p + x > 3", 3),
        ("p > x", 1),
        ("p > 3 foo", 5),
        ("p > 3 1", 1),
        ("missing.pressure > 3", 1),
        ("p > 1 and r > 3", 11),
        ("T * 2 > 3", 3),
        ("T + T > 3", 3),
        ("abs(T) > 3", 1),
        ("3 K - T > 3", 5),
        ("p / 0 > 3", 3),
        ("odd > 3 Pa", 1),
    ],
)
def test_what_does_not_fit_is_refused_with_its_column(text: str, column: int) -> None:
    with pytest.raises(MonitorError) as caught:
        check(parse(text), UNITS)
    assert caught.value.column == column


@pytest.mark.parametrize(
    "text",
    ["always p > 1", "p > 1 until q > 1", "always[0,1s] once[1s,inf) p > 1", "p > 1 since q > 1"],
)
def test_bounded_memory_needs_bounded_windows(text: str) -> None:
    formula = parse(text)
    check(formula, UNITS)
    with pytest.raises(MonitorError):
        check(formula, UNITS, bounded=True)


def test_windows_that_reach_too_far_together_are_refused() -> None:
    text = "always[0,3000d] " * 3 + "p > 1"
    with pytest.raises(MonitorError):
        check(parse(text), UNITS)


@pytest.mark.parametrize(
    ("text", "past", "future"),
    [
        ("p > 1", 0, 0),
        ("always[1ns,5ns] p > 1", 0, 5),
        ("once[1ns,5ns] p > 1", 5, 0),
        ("always[1ns,5ns] once[2ns,3ns] p > 1", 2, 3),
        ("always[1ns,5ns] eventually[2ns,3ns] p > 1", 0, 8),
        ("p > 1 until[2ns,9ns] once[0,4ns] q > 1", 2, 9),
        ("p > 1 since[2ns,9ns] q > 1", 9, 0),
        ("always p > 1", 0, None),
        ("once p > 1 and p > 2", None, 0),
    ],
)
def test_horizon(text: str, past: int | None, future: int | None) -> None:
    assert horizon(parse(text)) == (past, future)


@pytest.mark.parametrize(
    ("text", "exact"),
    [
        ("p > 3", True),
        ("p > q", True),
        ("always[0,1s](p > 3) and eventually[0,1s](q < 2)", True),
        ("always[0,1s](p > 3) and eventually[0,1s](p < 2)", False),
        ("always[0,1s](p > 3) and not eventually[0,1s](p < 2)", True),
        ("p > 3 implies p > 2", False),
        ("abs(p) > 3", True),
        ("abs(p) > 3 and abs(p) > 2", False),
        ("abs(p) > 3 implies abs(p) > 3", False),
        ("min(p, q) > 3 and max(p, 1) > 2", True),
        ("p - p > 0", False),
        ("p > q and q > n", False),
        ("p > q and n > q", True),
        ("p + q > 3", False),
        ("rise(p > 3)", False),
        ("count(p > 3, q > 3) >= 1", True),
        ("count(p > 3, q > 3) <= 1 and p < 2", True),
        ("not p > 3 until[0,1s] p < 2", True),
    ],
)
def test_exactness(text: str, *, exact: bool) -> None:
    found = is_exact(parse(text))
    assert bool(found) is exact
    assert bool(found.reasons) is not exact


@pytest.mark.parametrize(
    ("code", "scale"),
    [
        ("kPa", 10**6),
        ("N/m2", 1000),
        ("m.s-1", 1),
        ("ms", Fraction(1, 1000)),
        ("min", 60),
        ("dam", 10),
        ("%", Fraction(1, 100)),
        ("1", 1),
        ("Pa", 1000),
        ("cd", 1),
        ("h", 3600),
    ],
)
def test_unit_has_its_exact_factor(code: str, scale: Fraction | int) -> None:
    unit = known_unit(code)
    assert unit is not None
    assert unit.scale == scale


@pytest.mark.parametrize("code", ["", "foo", "kk", "m/", "/m2.", "m..s", "Pa Pa", "kmin", "3"])
def test_what_is_no_unit_is_not_known(code: str) -> None:
    assert known_unit(code) is None


@pytest.mark.parametrize(
    ("text", "unit", "value", "verdict"),
    [
        ("x >= 0.3 kPa", "Pa", 300.0, Verdict.CERTAIN),
        ("x > 0.3 kPa", "Pa", 300.0, Verdict.IMPOSSIBLE),
        ("x > 0.3 kPa", "Pa", np.nextafter(300.0, 301.0), Verdict.CERTAIN),
        ("x >= 0.1", "1", 0.1, Verdict.CERTAIN),  # the float 0.1 lies above 1/10
        ("x <= 0.1", "1", 0.1, Verdict.IMPOSSIBLE),
        ("0.1 < x", "1", 0.1, Verdict.CERTAIN),
        ("x < 0.3", "1", 0.3, Verdict.CERTAIN),  # and 0.3 below 3/10
        ("x >= 0.3", "1", 0.3, Verdict.IMPOSSIBLE),
        ("0.3 > x", "1", 0.3, Verdict.CERTAIN),
        ("x > 300 K", "Cel", 26.85, Verdict.CERTAIN),  # the float lies above 26.85
        ("x > 26.85", "Cel", 26.85, Verdict.CERTAIN),
        ("x < 1e400", "1", 1e308, Verdict.CERTAIN),
        ("x > -1e400", "1", -1e308, Verdict.CERTAIN),
        ("x > 1e-400", "1", 0.0, Verdict.IMPOSSIBLE),
        ("x > 1e-400", "1", 5e-324, Verdict.CERTAIN),
        ("x / (x - x) > 0", "1", 1.0, Verdict.POSSIBLE),
    ],
)
def test_constants_are_compared_exactly(
    text: str, unit: str, value: float, verdict: Verdict
) -> None:
    found = evaluate(parse(text), {"x": Signal([5], [5], [value], [value], 1, unit=unit)})
    assert found.at(5) is verdict


def test_channels_in_two_units_round_outward() -> None:
    for value in (0.1, 0.3, 1 / 3):
        one = Signal([5], [5], [value], [value], 1, unit="kPa")
        other = Signal([5], [5], [value * 1000], [value * 1000], 1, unit="Pa")
        found = evaluate(parse("k >= p"), {"k": one, "p": other}).at(5)
        true = Fraction(value) * 1000 >= Fraction(value * 1000)
        assert found in {Verdict.POSSIBLE, Verdict.CERTAIN if true else Verdict.IMPOSSIBLE}
