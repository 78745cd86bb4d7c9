"""Intervals in SenML: every bound exact, every time within its nanosecond."""

from __future__ import annotations

import json
import math
from fractions import Fraction
from typing import Any

import cbor2
from hypothesis import given
from hypothesis import strategies as st

from eskin.wire import senml
from eskin.wire.timestamp import SECOND
from tests.unit.eskin.senml import read_senml

T0 = 1_800_000_000_123_456_789
NAME = "fingertip/t01.capacitance/"

bound = st.floats(allow_nan=False)
samples = st.lists(
    st.tuples(st.integers(0, 2**62), bound, bound).map(lambda s: (s[0], min(s[1:]), max(s[1:]))),
    min_size=1,
    max_size=20,
)


def pack(found: list[tuple[int, float, float]], unit: str = "F") -> senml.Pack:
    t, lo, hi = zip(*found, strict=True)
    return senml.Pack(NAME, unit, T0, t, lo, hi, {"coverage": (0.5, senml.RATIO)})


def expected(found: list[tuple[int, float, float]]) -> list[tuple[str, int, float]]:
    sides = [(("lo", t, lo), ("hi", t, hi)) for t, lo, hi in found]
    return [side for both in sides for side in both if math.isfinite(side[2])]


def resolved(records: list[dict[Any, Any]], n: Any, t: Any, v: Any, bt: Any) -> list[Any]:
    """Names, ns after ``T0`` by the base time that holds, values; of what has a time."""
    found, base = [], 0
    for record in records:
        base = record.get(bt, base)
        if t in record:
            instant = base * SECOND + round(Fraction(record[t]) * SECOND)
            found.append((record[n], instant - T0, record[v]))
    return found


def test_time_far_from_the_first_comes_with_a_new_base_time() -> None:
    year = 365 * 86_400 * SECOND
    stated = [(0, 1.0, 2.0), (year + 1, -math.inf, math.inf), (year + 2, 1.0, math.inf)]
    first, low, high, last = json.loads(senml.as_json(pack(stated)))
    assert [first["bt"], last["bt"]] == [T0 // SECOND, (T0 + year) // SECOND]
    assert "bt" not in low | high
    assert resolved([first, low, high, last], "n", "t", "v", "bt")[-1] == ("lo", year + 2, 1.0)


@given(found=samples)
def test_both_forms_tell_every_finite_bound_exactly_at_its_nanosecond(
    found: list[tuple[int, float, float]],
) -> None:
    # Where nothing is bounded, nothing is said; an infinite bound is unbounded whichever its sign.
    stated = [
        (t, -math.inf if math.isinf(lo) else lo, math.inf if math.isinf(hi) else hi)
        for t, lo, hi in found
    ]
    plain = json.loads(senml.as_json(pack(stated)))
    short = cbor2.loads(senml.as_cbor(pack(stated)))
    assert resolved(plain, "n", "t", "v", "bt") == expected(stated)
    assert resolved(short, 0, 6, 2, -3) == expected(stated)
    values = [("coverage", 0.5), *((name, value) for name, _, value in expected(stated))]
    assert read_senml(senml.as_json(pack(stated)).decode(), NAME) == values
    assert read_senml(senml.as_cbor(pack(stated)), NAME) == values


def test_units_are_senmls() -> None:
    stated = {unit: json.loads(senml.as_json(pack([(0, 1.0, 2.0)], unit)))[0] for unit in "F%1x"}
    assert [stated[unit].get("bu") for unit in "F%1x"] == ["F", "%RH", "/", None]


@given(nanoseconds=st.integers(0, 2**63))
def test_length_in_seconds_is_never_short(nanoseconds: int) -> None:
    stated = senml.seconds(nanoseconds)
    assert Fraction(stated) >= Fraction(nanoseconds, SECOND)
    assert math.nextafter(stated, 0.0) == 0.0 or Fraction(math.nextafter(stated, 0.0)) < Fraction(
        nanoseconds, SECOND
    )
