"""The library's verdicts are those of the definition, and none says less than could be known.

An engine that always says *possible* fails here: verdicts are compared, not only held against
worlds. ``python -m tests.robustness.monitors`` does the same for as many scenes as you like.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from eskin.interval import Verdict
from eskin.monitor import Signal, evaluate, is_exact, parse
from tests.unit.eskin.monitor.oracle.judge import judge

if TYPE_CHECKING:
    from collections.abc import Sequence

SCENES = 150


@pytest.mark.parametrize("part", range(10))
def test_verdicts_on_random_scenes_are_those_of_the_definition(part: int) -> None:
    outcome = judge(range(SCENES), label=f"part {part}")
    assert not outcome.wrong
    assert outcome.exact > SCENES / 4
    assert min(outcome.verdicts[verdict] for verdict in Verdict) > SCENES


def held(values: Sequence[tuple[float, float]], unit: str = "Pa", period: int = 10) -> Signal:
    """Samples a period apart from 0 on, and one more than its values to close the last."""
    enclosures = np.arange(len(values)) * period
    lo, hi = np.array(values).T
    return Signal(enclosures, enclosures, lo, hi, period, unit=unit, until=len(values) * period)


@pytest.mark.parametrize(
    ("text", "value", "verdict"),
    [
        # A constant's decimal is compared itself, not the float beside it.
        ("p > 0.1", 0.1, Verdict.CERTAIN),
        ("p <= 0.1", 0.1, Verdict.IMPOSSIBLE),
        ("p > 0.3", 0.3, Verdict.IMPOSSIBLE),
        ("p >= 0.3", np.nextafter(0.3, 1.0), Verdict.CERTAIN),
        ("p < 0.3", 0.3, Verdict.CERTAIN),
        # 0.1 kPa are 100 Pa, although the float 0.1 is more than 1/10.
        ("p > 0.1 kPa", 100.0, Verdict.IMPOSSIBLE),
        ("p >= 0.1 kPa", 100.0, Verdict.CERTAIN),
        ("p >= 0.1 kPa", np.nextafter(100.0, 0.0), Verdict.IMPOSSIBLE),
        ("p < 0.0001 MPa", np.nextafter(100.0, 0.0), Verdict.CERTAIN),
        ("0.1 kPa > p", 100.0, Verdict.IMPOSSIBLE),
        ("-p < -0.1 kPa", 100.0, Verdict.IMPOSSIBLE),
    ],
)
def test_thresholds_are_exact(text: str, value: float, verdict: Verdict) -> None:
    assert evaluate(parse(text), {"p": held([(value, value)])}).at(5) is verdict


def test_temperatures_are_converted_with_their_offset() -> None:
    read = {"t": held([(26.85, 26.85)], unit="Cel")}
    assert evaluate(parse("t >= 299 K"), read).at(5) is Verdict.CERTAIN
    assert evaluate(parse("t > 301 K"), read).at(5) is Verdict.IMPOSSIBLE


@pytest.mark.parametrize(
    ("text", "signals"),
    [
        # Each instant has a value of p that makes it true; no one value does for both of q's.
        ("always[0,10ns](p * q > 0)", {"p": [(-1, 1), (-1, 1)], "q": [(1, 1), (-1, -1)]}),
        ("always[0,10ns](abs(p - q) > 6)", {"p": [(0, 10), (0, 10)], "q": [(0, 0), (10, 10)]}),
        # Each channel once a comparison, but in both directions.
        ("always[0,9ns](p > 3) and eventually[0,9ns](p < 2)", {"p": [(0, 9)]}),
        ("rise(p > 3) and fall(p > 3)", {"p": [(0, 9), (0, 9)]}),
        ("count(p > 3, p <= 3) >= 2", {"p": [(0, 9)]}),
        ("p - p > 1", {"p": [(0, 9)]}),
    ],
)
def test_formulas_that_no_world_satisfies_are_not_called_exact(
    text: str, signals: dict[str, list[tuple[float, float]]]
) -> None:
    formula = parse(text)
    # q changes within the time that one sample of p is held.
    read = {
        name: held(values, period=10 if name == "q" else 20) for name, values in signals.items()
    }
    assert not is_exact(formula)
    assert evaluate(formula, read).at(0) is not Verdict.CERTAIN


@pytest.mark.parametrize(
    "text",
    [
        "p > 3",
        "always[0,1s](p > 3 implies eventually[0,1s] q < 2)",
        "not ((p < 3) until[1s,2s] (q > 0.1 kPa))",
        "once (p > 3 and p > 5)",
        "count(p > 3, q < 2, p > 5) >= 2",
    ],
)
def test_formulas_of_one_direction_are_called_exact(text: str) -> None:
    assert is_exact(parse(text))
