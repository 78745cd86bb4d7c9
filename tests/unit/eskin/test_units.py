"""A value that carries a unit is rejected wherever eskin takes plain numbers in SI units."""

from __future__ import annotations

import inspect
from typing import TYPE_CHECKING, Any, Self

import numpy as np
import pint
import pytest

from eskin import design, models, noise
from eskin.client.queries import Queries
from eskin.design import Narrower, Within, invert
from eskin.errors import EskinError, IntervalError
from eskin.interval import Interval, as_interval
from eskin.models import icm
from eskin.peaks import PeakStream, find_peaks
from eskin.tube import Tube

if TYPE_CHECKING:
    from collections.abc import Callable

UNITS: Any = pint.UnitRegistry()


class AstropyLike(np.ndarray[Any, Any]):
    """An array that carries its unit as astropy's does, a subclass that numpy takes for plain."""

    unit = "cm"

    @classmethod
    def of(cls, numbers: Any) -> Self:
        return np.asarray(numbers, dtype=np.float64).view(cls)


class UnytLike(AstropyLike):
    """As unyt has it."""

    unit = None  # type: ignore[assignment]
    units = "cm"


QUANTITIES: dict[str, Callable[[Any], Any]] = {
    "pint": lambda number: UNITS.Quantity(number, "cm**2"),
    "pint, pure number": lambda number: UNITS.Quantity(number, "percent"),
    "pint, dimensionless": lambda number: UNITS.Quantity(number, ""),
    "astropy": AstropyLike.of,
    "unyt": UnytLike.of,
}
quantities = pytest.mark.parametrize("quantity", QUANTITIES.values(), ids=QUANTITIES.keys())


@quantities
def test_interval_rejects_quantities(quantity: Callable[[Any], Any]) -> None:
    one, many = quantity(1.0), quantity(np.array([1.0, 2.0]))
    x = Interval(1.0, 2.0)
    for call in (
        lambda: Interval(one),
        lambda: Interval(0.0, one),
        lambda: Interval(many),
        lambda: Interval([one, one]),
        lambda: Interval([[0.0, 1.0], (one, 2.0)]),
        lambda: Interval.around(one, 0.1),
        lambda: Interval.around(1.0, one),
        lambda: Interval.relative(1.0, one),
        lambda: as_interval(many),
        lambda: x.contains(one),
        lambda: x.hypot(one),
        lambda: x.convex_hull(one),
        lambda: x.fma(one, 1.0),
        lambda: x.pow(one),
        lambda: x**one,
        lambda: x.pown(one),
        lambda: x < one,
        lambda: x == one,
    ):
        with pytest.raises(EskinError):
            call()


def test_pint_keeps_its_unit_in_arithmetic() -> None:
    """pint knows how to hold intervals: nothing is dropped there."""
    area = UNITS.Quantity(Interval(1.0, 2.0), "cm**2")
    doubled = Interval(2.0) * area
    assert doubled.units == UNITS.Unit("cm**2")
    with pytest.raises(IntervalError):
        models.capacitance(relative_permittivity=1.0, area=area, distance=1e-3)
    metres = area.to("m**2").magnitude
    assert isinstance(metres, Interval)
    found = models.capacitance(relative_permittivity=1.0, area=metres, distance=1e-3)
    assert np.all(found.contains(8.8541878188e-12 * 1.5e-4 / 1e-3))


VALUES = {"maximum": 2.0, "mean": 2.0, "base": 2.0, "steps": 3, "step": 0.1}
MODELS = {
    name: getattr(module, name)
    for module in (models, icm)
    for name in module.__all__
    if inspect.isfunction(getattr(module, name))
}


def plain_arguments(model: Callable[..., Any]) -> dict[str, Any]:
    names = [n for n in inspect.signature(model).parameters if n not in {"swing", "rule"}]
    values: dict[str, Any] = {name: VALUES.get(name.split("_")[0], 1.0) for name in names}
    if model is models.oscillation:
        values |= {"time": np.array([0.0, 0.1]), "frequency": Interval([1.0], [2.0])}
    return values


@quantities
@pytest.mark.parametrize("name", MODELS)
def test_model_rejects_each_parameter_with_a_unit(
    name: str, quantity: Callable[[Any], Any]
) -> None:
    model = MODELS[name]
    given = plain_arguments(model)
    model(**given)
    for parameter, value in given.items():
        if parameter == "steps":
            continue
        number = value.inf if isinstance(value, Interval) else value
        for carried in (quantity(number), quantity(np.array([number]))):
            with pytest.raises(IntervalError):
                model(**{**given, parameter: carried})


@quantities
def test_state_space_rejects_quantities(quantity: Callable[[Any], Any]) -> None:
    space = icm.state_space(
        coil_resistance=1.0, inductance=1.0, capacitor_resistance=1.0, capacitance=1.0
    )
    given = {"time": 1.0, "amplitude": 1.0, "frequency": 1.0, "phase": 0.0}
    for name in given:
        with pytest.raises(IntervalError):
            space.phasor_response(**{**given, name: quantity(1.0)})
    with pytest.raises(IntervalError):
        space.slope(quantity(np.zeros(2)), 1.0)
    with pytest.raises(IntervalError):
        space.slope([0.0, 0.0], quantity(1.0))


@quantities
def test_noise_rejects_quantities(quantity: Callable[[Any], Any]) -> None:
    one: Any = quantity(1.0)
    rates = {"untouched": 0.0, "touched": 1.0, "noise": [1.0], "threshold": [1.0]}
    touch: dict[str, Any] = {"distance": 1.0, "voltage": 1.0, "vacuum_permittivity": 1.0}
    still: dict[str, Any] = {
        "noise": noise.GaussianNoise(),
        "generator": np.random.default_rng(1),
    }
    calls: list[Callable[[], Any]] = [
        lambda: noise.GaussianNoise(area=one),
        lambda: noise.coverage_within(one),
        lambda: noise.upper_tail(one),
        lambda: noise.detect(one, 1.0),
        lambda: noise.detect([1.0], one),
        lambda: noise.touch_with_noise(one, **touch, **still),
        lambda: noise.touch_within(1.0, **touch, noise=noise.GaussianNoise(), deviations=one),
    ]
    for call in calls:
        with pytest.raises(EskinError):
            call()
    for name in touch:
        with pytest.raises(IntervalError):
            noise.touch_with_noise(1.0, **{**touch, name: one}, **still)
    for name in rates:
        with pytest.raises(IntervalError):
            noise.error_rates(**{**rates, name: one})


@quantities
def test_design_rejects_quantities(quantity: Callable[[Any], Any]) -> None:
    def same(*, x: Any) -> Any:
        return x

    one: Any = quantity(0.5)
    space = {"x": Interval(0.0, 1.0)}
    paving = invert(Within(same, 0.0, 0.5), space)
    for call in (
        lambda: Within(same, lo=one),
        lambda: Within(same, hi=one),
        lambda: Narrower(same, width=one, tolerance={"x": 0.1}),
        lambda: Narrower(same, width=1.0, tolerance={"x": one}),
        lambda: Within(same, for_every={"y": one}),
        lambda: invert(Within(same), {"x": one}),
        lambda: invert(Within(same), space, resolution=one),
        lambda: invert(Within(lambda *, x: x * Interval(one)), space),
        lambda: paving.region(x=one),
        lambda: design.sensitivity(same, {"x": one}),
        lambda: design.sensitivity(lambda *, x: x + one, space),
    ):
        with pytest.raises(EskinError):
            call()


@quantities
def test_tube_and_peaks_reject_quantities(quantity: Callable[[Any], Any]) -> None:
    values, signal = Interval([0.0, 1.0, 0.0]), [0.0, 1.0, 0.0]
    one: Any = quantity(1.0)
    whole: Any = quantity(1)
    for call in (
        lambda: Tube((0, 0), 1, quantity(np.array(signal)), "V", 1.0),
        lambda: Tube((0, 0), 1, values, "V", one),
        lambda: Tube((0, 0), whole, values, "V", 1.0),
        lambda: Tube((0, whole), 1, values, "V", 1.0),
        lambda: find_peaks(values, prominence=one),
        lambda: find_peaks(quantity(np.array(signal)), signal, prominence=0.5),
        lambda: find_peaks(signal, quantity(np.array(signal)), prominence=0.5),
        lambda: find_peaks([quantity(x) for x in signal], signal, prominence=0.5),
        lambda: PeakStream(one),
        lambda: PeakStream(0.5).feed(signal, quantity(np.array(signal))),
    ):
        with pytest.raises(EskinError):
            call()


@quantities
def test_client_rejects_parameters_with_a_unit(quantity: Callable[[Any], Any]) -> None:
    nowhere: Any = None  # the question is rejected before it is asked
    for name in ("anomalies", "anomalies_time", "prediction"):
        ask = getattr(Queries(nowhere), name)
        with pytest.raises(IntervalError):
            ask("palm", "t01.capacitance", "touch.capacitance", {"distance": quantity(1.0)})


def test_masked_parameter_of_a_model_is_rejected() -> None:
    area = np.ma.masked_array([1.0, 2.0], mask=[False, True])
    with pytest.raises(IntervalError):
        models.capacitance(relative_permittivity=1.0, area=area, distance=1.0)
