"""The width under tolerances lies between its bounds at every point, and they close in on it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from eskin.design.tolerance import enclose_spread
from eskin.errors import DesignError
from eskin.interval import Interval
from eskin.models import formulas

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    Formula = Callable[..., Any]

TOLERANCE = {"x": 0.05, "y": 0.02}
FORMULAS: dict[str, Formula] = {
    "quotient": lambda x, y, a: a * y / x,
    "wave": lambda x, y, a: np.sin(3.0 * x) * y + a,
    "hill": lambda x, y, a: a * (x - y) * (x - 1.5) * (x - 1.5),
    "flat": lambda x, y, a: a + 0.0 * x * y,
    "decay": lambda x, y, a: np.exp(-x * a) / np.sqrt(y),
    "hybrid": lambda x, y, a: formulas.icm_response(
        time_constant=x * 1e-3, angular_frequency=314.0 * y, time=a * 1e-3, phase=-0.8
    ),
}
"""Rising, falling, and with an extremum inside of the tolerance."""


def plain_response(x: Any, y: Any, a: Any) -> Any:
    theta, slow = 0.314 * y * a - 0.8, 0.314 * y * x
    start = (np.sin(-0.8) - slow * np.cos(-0.8)) * np.exp(-a / x)
    return (np.sin(theta) - slow * np.cos(theta) - start) / (1.0 + slow * slow)


def sampled_width(name: str, x: float, y: float, a: float) -> float:
    """The greatest difference on a fine grid of the tolerances, its corners among it."""
    shares = np.linspace(-1.0, 1.0, 41)
    moved = np.meshgrid(x * (1.0 + 0.05 * shares), y * (1.0 + 0.02 * shares))
    values = (plain_response if name == "hybrid" else FORMULAS[name])(*moved, a)
    return float(np.ptp(values))


def boxed(lo: float, width: float, axis: int = 1) -> Interval:
    shape = (-1, 1) if axis else (1, -1)
    return Interval(np.reshape(lo, shape), np.reshape(lo + width, shape))


@pytest.mark.parametrize("name", FORMULAS)
@given(
    corner=st.tuples(*[st.floats(0.5, 3.0)] * 3),
    sides=st.tuples(*[st.sampled_from([0.0, 1e-3, 0.05, 0.5])] * 3),
    places=st.lists(st.tuples(*[st.floats(0.0, 1.0)] * 3), min_size=1, max_size=5),
)
@settings(max_examples=40, deadline=None)
def test_width_of_every_point_is_enclosed(
    name: str,
    corner: tuple[float, float, float],
    sides: tuple[float, float, float],
    places: list[tuple[float, float, float]],
) -> None:
    boxes = {"x": boxed(corner[0], sides[0]), "y": boxed(corner[1], sides[1])}
    others = {"a": boxed(corner[2], sides[2], axis=0)}
    least, most = enclose_spread(FORMULAS[name], boxes, others, TOLERANCE)
    for place in places:
        point = [c + s * p for c, s, p in zip(corner, sides, place, strict=True)]
        width = sampled_width(name, *point)
        assert least.item() <= width * (1.0 + 1e-9) + 1e-13
        assert width <= most.item() * (1.0 + 1e-9) + 1e-13


def gap(name: str, side: float) -> float:
    boxes = {"x": boxed(1.0, side), "y": boxed(2.0, side)}
    least, most = enclose_spread(FORMULAS[name], boxes, {"a": boxed(1.0, 0.0, axis=0)}, TOLERANCE)
    return float((most - least).item())


@pytest.mark.parametrize("name", ["quotient", "decay"])
def test_bounds_close_in_on_the_width(name: str) -> None:
    thin: NDArray[Any] = np.array(gap(name, 0.0))
    assert thin < 1e-12
    width = sampled_width(name, 1.0, 2.0, 1.0)
    assert gap(name, 0.02) < 0.12 * width
    assert gap(name, 0.01) < 0.06 * width  # what a box's own extent would add: 0.01 of 0.2


def test_slopes_of_one_sign_make_a_thin_box_exact() -> None:
    boxes = {"x": boxed(1.0, 0.0), "y": boxed(2.0, 0.0)}
    least, most = enclose_spread(FORMULAS["quotient"], boxes, {"a": boxed(3.0, 0.0, 0)}, TOLERANCE)
    exact = 3.0 * 2.0 * (1.02 / 0.95 - 0.98 / 1.05)
    assert least.item() <= exact <= most.item()
    assert most.item() - least.item() < 1e-13


def test_slopes_of_one_sign_make_a_small_box_exact() -> None:
    boxes = {"x": boxed(1.0, 1e-3), "y": boxed(2.0, 1e-3)}
    least, most = enclose_spread(FORMULAS["quotient"], boxes, {"a": boxed(3.0, 0.0, 0)}, TOLERANCE)
    factor = 3.0 * (1.02 / 0.95 - 0.98 / 1.05)
    assert least.item() == pytest.approx(factor * 2.0 / 1.001, rel=1e-12)
    assert most.item() == pytest.approx(factor * 2.001, rel=1e-12)


def test_parts_without_tolerance_do_not_spread() -> None:
    boxes = {"x": boxed(1.0, 0.0), "y": boxed(2.0, 0.0)}
    others = {"a": boxed(3.0, 0.0, 0)}
    least, most = enclose_spread(FORMULAS["quotient"], boxes, others, {"x": 0.05, "y": 0.0})
    assert least.item() == pytest.approx(6.0 / 0.95 - 6.0 / 1.05, rel=1e-12)
    assert most.item() == pytest.approx(6.0 / 0.95 - 6.0 / 1.05, rel=1e-12)


def test_output_without_a_value_meets_no_limit() -> None:
    boxes = {"x": boxed(-2.0, 0.1), "y": boxed(2.0, 0.1)}
    least, most = enclose_spread(lambda x, y: np.sqrt(x) * y, boxes, {}, TOLERANCE)
    assert least.item() == most.item() == np.inf


def test_model_that_is_no_expression_is_named() -> None:
    with pytest.raises(DesignError, match="gave float; it must be an expression"):
        enclose_spread(lambda x, y: 1.0, {"x": boxed(1, 1), "y": boxed(1, 1)}, {}, TOLERANCE)  # noqa: ARG005 - that is the point
