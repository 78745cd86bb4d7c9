"""Where an output is undefined it meets nothing, whatever box a point is judged in."""

from __future__ import annotations

import math
from contextlib import suppress
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from eskin.design import All, Narrower, Region, Within, invert, sensitivity
from eskin.errors import DesignError, IntervalError
from eskin.interval import Interval

if TYPE_CHECKING:
    from collections.abc import Callable

    from eskin.design import Requirement

PARTIAL: dict[str, Callable[..., Any]] = {
    "log": lambda *, x: np.log(x),
    "reciprocal": lambda *, x: 1.0 / x,
    "root": lambda *, x: np.sqrt(x),
    "shifted root": lambda *, x: np.sqrt(x - 1.0),
    "negative power": lambda *, x: (x - 0.25) ** -2,
    "root of a difference": lambda *, x: np.sqrt(x * x - 0.25) + x,
    "quotient": lambda *, x: x / (x * x - 0.5),
    "log of a quotient": lambda *, x: np.log((x + 0.5) / (x - 0.5)),
}
BY_VALUE: dict[str, Callable[..., Any]] = {
    "arc sine": lambda *, x: np.arcsin(x),
    "arc cosine": lambda *, x: np.arccos(x),
    "arc cosh": lambda *, x: np.arccosh(x),
    "arc tanh": lambda *, x: np.arctanh(x),
    "log1p": lambda *, x: np.log1p(x - 0.5),
    "log2": lambda *, x: np.log2(x),
    "log10": lambda *, x: np.log10(x),
    "real power": lambda *, x: np.power(x, 0.5),
    "negative real power": lambda *, x: np.power(x, -1.5),
    "tangent": lambda *, x: np.tan(4.0 * x),
}
SPACES = st.tuples(st.floats(-2.0, 1.9), st.floats(0.01, 3.0)).map(
    lambda ends: Interval(ends[0], ends[0] + ends[1])
)


def at(formula: Callable[..., Any], x: float) -> float:
    """The value at a point; NaN where there is none."""
    with np.errstate(all="ignore"):
        found = float(formula(x=np.float64(x)))
    return found if math.isfinite(found) else math.nan


def meets_band(formula: Callable[..., Any], lo: float, hi: float) -> Callable[[float], bool]:
    return lambda x: lo <= at(formula, x) <= hi


def meets_width(formula: Callable[..., Any], width: float, share: float) -> Callable[[float], bool]:
    def meets(x: float) -> bool:
        ends = sorted((x * (1.0 - share), x * (1.0 + share)))
        values = [at(formula, float(point)) for point in np.linspace(ends[0], ends[1], 17)]
        return not np.isnan(values).any() and max(values) - min(values) <= width

    return meets


def judged_right(
    requirement: Requirement, space: Interval, meets: Callable[[float], bool], slack: float = 0.0
) -> None:
    """No point of a certain box fails, no point of a box that is never meets.

    Points where rounding decides are left out: those that change within ``slack`` of them.
    """
    paving = invert(requirement, {"x": space}, resolution=1 / 32)
    for lo, hi, region in zip(paving.lo[:, 0], paving.hi[:, 0], paving.regions, strict=True):
        for point in np.linspace(lo, hi, 3):
            found = {meets(float(point + move)) for move in (-slack, 0.0, slack)}
            if len(found) == 1 and region != Region.POSSIBLE:
                assert found == {region == Region.CERTAIN}, (point, region)


@pytest.mark.parametrize("name", PARTIAL | BY_VALUE)
@settings(max_examples=30)
@given(space=SPACES, lo=st.floats(-5.0, 2.0), width=st.floats(0.1, 10.0))
def test_band_is_met_only_where_the_output_is_defined(
    name: str, space: Interval, lo: float, width: float
) -> None:
    formula = (PARTIAL | BY_VALUE)[name]
    judged_right(Within(formula, lo, lo + width), space, meets_band(formula, lo, lo + width), 1e-9)


@pytest.mark.parametrize("expression", [True, False])
@pytest.mark.parametrize("name", PARTIAL)
@settings(max_examples=30)
@given(space=SPACES, width=st.floats(1e-3, 2.0), share=st.floats(1e-3, 0.3))
def test_width_is_met_only_where_the_output_is_defined(
    name: str,
    expression: bool,  # noqa: FBT001
    space: Interval,
    width: float,
    share: float,
) -> None:
    formula = PARTIAL[name]
    narrow = Narrower(formula, width=width, tolerance={"x": share}, expression=expression)
    judged_right(narrow, space, meets_width(formula, width, share), 1e-9)


@pytest.mark.parametrize(
    ("formula", "space"),
    [
        (PARTIAL["log"], Interval(-1.0, 1.0)),
        (PARTIAL["reciprocal"], Interval(-1.0, 1.0)),
        (PARTIAL["reciprocal"], Interval(-1.0, 2.0)),
        (PARTIAL["root"], Interval(-1.0, 0.9)),
    ],
)
@pytest.mark.parametrize("expression", [True, False])
def test_good_point_is_certain_beside_an_undefined_one(
    formula: Callable[..., Any],
    space: Interval,
    expression: bool,  # noqa: FBT001
) -> None:
    narrow = Narrower(formula, width=1.0, tolerance={"x": 0.01}, expression=expression)
    paving = invert(narrow, {"x": space})
    assert paving.region(x=0.5) == Region.CERTAIN
    assert paving.share(Region.CERTAIN) > 0.3


@pytest.mark.parametrize("space", [Interval(0.0, 2.0), Interval(0.0, 0.9), Interval(0.5, 0.6)])
def test_verdict_of_a_point_does_not_depend_on_the_space(space: Interval) -> None:
    band = Within(PARTIAL["shifted root"], -1.0, 10.0)
    both = All((band, Within(lambda *, x: x, 0.0, 10.0)))
    assert invert(band, {"x": space}).region(x=0.55) == Region.NEVER
    assert invert(both, {"x": space}).region(x=0.55) == Region.NEVER


def test_undefined_for_one_of_every_value_is_never() -> None:
    band = Within(lambda *, x, y: np.sqrt(x - y), -1.0, 10.0, for_every={"y": Interval(0.0, 1.0)})
    paving = invert(band, {"x": Interval(0.0, 2.0)})
    assert paving.region(x=0.5) == Region.NEVER
    assert paving.region(x=1.5) == Region.CERTAIN


@pytest.mark.parametrize(
    "output",
    [
        lambda *, x: np.sqrt(x).convex_hull(Interval(0.0)),
        lambda *, x: x.intersection(Interval(0.0, 1.0)),
        lambda *, x: Interval(np.exp(np.log(x)).sup, 1.0),
        lambda *, x: np.sqrt(x.reshape(-1)).reshape(-1, 1),
    ],
)
def test_undefined_part_is_seen_behind_what_forgets_it(output: Callable[..., Any]) -> None:
    """An output that takes bounds apart, or cuts them to a known range, hides where it is empty."""
    space = {"x": Interval(-1.0, 1.0)}
    with suppress(IntervalError):  # bounds of an empty interval
        paving = invert(Within(output, -1.0, 10.0), space)
        assert paving.region(x=-0.7) != Region.CERTAIN


@pytest.mark.parametrize("pieces", [1, 2, 16])
def test_slopes_of_an_undefined_output_are_rejected(pieces: int) -> None:
    with pytest.raises(DesignError):
        sensitivity(PARTIAL["shifted root"], {"x": Interval(0.0, 2.0)}, pieces=pieces)
