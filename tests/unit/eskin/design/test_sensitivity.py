"""Enclosed derivatives hold those of every point, and shrink to them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import mpmath
import numpy as np
import pytest

from eskin.design import Dual, sensitivity
from eskin.errors import DesignError
from eskin.interval import Interval
from eskin.models import formulas

if TYPE_CHECKING:
    from collections.abc import Callable

MILLI = Interval(1e-3, 5e-3)
CASES: dict[str, tuple[Callable[..., Any], dict[str, Interval], Callable[..., Any]]] = {
    "capacitance": (
        formulas.capacitance,
        {
            "relative_permittivity": Interval(1.0, 5.0),
            "area": Interval(1e-4, 2e-4),
            "distance": MILLI,
        },
        lambda relative_permittivity, area, distance: (
            8.854e-12 * relative_permittivity * area / distance
        ),
    ),
    "proximity_frequency": (
        formulas.proximity_frequency,
        {
            "base_inductance": Interval(0.0099, 0.0101),
            "inductance_change": Interval(0.0049, 0.0051),
            "damping": Interval(9.5, 10.5),
            "distance": Interval(0.01, 0.03),
            "capacitance": Interval(0.99e-6, 1.01e-6),
        },
        lambda base_inductance, inductance_change, damping, distance, capacitance: 1
        / (
            2
            * mpmath.pi
            * mpmath.sqrt(
                (base_inductance - inductance_change * mpmath.exp(-damping * distance))
                * capacitance
            )
        ),
    ),
    "coil_energy": (
        formulas.coil_energy,
        {
            "inductance": Interval(9e-3, 11e-3),
            "voltage": Interval(0.9, 1.1),
            "resistance": Interval(4.0, 6.0),
            "time": Interval(1e-4, 2e-3),
        },
        lambda inductance, voltage, resistance, time: (
            inductance / 2 * (voltage / resistance) ** 2
            * mpmath.exp(-2 * resistance * time / inductance)
        ),
    ),
    "icm_response": (
        formulas.icm_response,
        {
            "time_constant": Interval(2.3e-3, 2.5e-3),
            "angular_frequency": Interval(310.0, 318.0),
            "time": Interval(1e-3, 2e-3),
            "phase": Interval(-0.81, -0.79),
        },
        lambda time_constant, angular_frequency, time, phase: (
            mpmath.sin(angular_frequency * time + phase)
            - angular_frequency * time_constant * mpmath.cos(angular_frequency * time + phase)
            - (mpmath.sin(phase) - angular_frequency * time_constant * mpmath.cos(phase))
            * mpmath.exp(-time / time_constant)
        )
        / (1 + (angular_frequency * time_constant) ** 2),
    ),
}  # fmt: skip


def slope_along(exact: Callable[..., Any], point: dict[str, Any], parameter: str) -> Any:
    return mpmath.diff(lambda x: exact(**(point | {parameter: x})), point[parameter])


@pytest.mark.parametrize("name", CASES)
def test_derivatives_of_all_points_are_enclosed(name: str) -> None:
    formula, box, exact = CASES[name]
    found = sensitivity(formula, box, pieces=4)
    random = np.random.default_rng(11)
    with mpmath.workprec(200):
        for _ in range(20):
            point = {
                key: mpmath.mpf(random.uniform(float(value.inf), float(value.sup)))
                for key, value in box.items()
            }
            for parameter in box:
                slope = slope_along(exact, point, parameter)
                share = slope * point[parameter] / exact(**point)
                derivative, elasticity = found[parameter].derivative, found[parameter].elasticity
                assert float(derivative.inf) <= slope <= float(derivative.sup)
                assert float(elasticity.inf) <= share <= float(elasticity.sup)


def test_more_pieces_come_nearer_to_the_truth() -> None:
    box = {"x": Interval(0.0, 3.0)}
    widths = [
        float(sensitivity(lambda x: np.sin(x) * x, box, pieces=n)["x"].derivative.wid)
        for n in (1, 8, 64)
    ]
    truth = 1.0 - (np.sin(3.0) + 3.0 * np.cos(3.0)) + 0.4
    assert widths[0] > widths[1] > widths[2] > truth - 0.4


def test_power_law_has_a_constant_elasticity() -> None:
    found = sensitivity(lambda x: 5.0 * x**3 / np.sqrt(x), {"x": Interval(2.0, 2.0)})
    assert found["x"].elasticity.contains(2.5)
    assert found["x"].elasticity.wid < 1e-14


def test_what_cannot_be_differentiated_is_named() -> None:
    with pytest.raises(DesignError, match="tanh cannot be differentiated"):
        np.tanh(Dual(Interval(1.0), {}))
    with pytest.raises(DesignError, match="only whole numbers"):
        Dual(Interval(1.0), {}) ** 0.5  # type: ignore[operator]  # a wrong call on purpose
    assert (Dual(Interval(3.0), {}) ** np.int64(2)).value.contains(9.0)
    with pytest.raises(DesignError, match="uses none"):
        sensitivity(lambda x: 1.0, {"x": Interval(0.0, 1.0)})  # noqa: ARG005 - that is the point
    with pytest.raises(DesignError, match="take fewer"):
        sensitivity(lambda **_: 1.0, {name: Interval(0.0, 1.0) for name in "abcdef"}, pieces=16)


@pytest.mark.parametrize(
    ("value", "pieces", "reason"),
    [
        (1.0, 4, "x: 1.0 is no Interval"),
        (Interval(1.0, np.inf), 4, "no bounded interval"),
        (Interval([1.0, 2.0]), 4, "no bounded interval"),
        (Interval(1.0, 2.0), 0, "pieces: 0"),
        (Interval(-4.0, -1.0), 4, "no value on a part"),
    ],
)
def test_box_that_cannot_be_divided_is_refused(value: Any, pieces: int, reason: str) -> None:
    with pytest.raises(DesignError, match=reason):
        sensitivity(lambda x: 2.0 * np.sqrt(x), {"x": value}, pieces=pieces)
