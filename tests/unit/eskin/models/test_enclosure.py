"""Every model encloses what its formula gives for any members, and hardly more."""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
import pytest

from eskin.interval import Interval
from tests.unit.eskin.models.cases import CASES, Case, encloses, members

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    Floats: TypeAlias = NDArray[np.float64]

BOXES = 150
MEMBERS = 6
ULP = 2.0**-52
HUMPED = {"resonance", "energy_flow"}
"""Models with results that are not monotone: their widest member need not be a corner."""
CANCELLED = dict.fromkeys(("reactance", "impedance", "current", "phase"), 1e-10)
"""Where ωL and 1/(ωC) cancel, rounding counts against them: hundreds of Ω, and per 0.1 Ω."""
SPREAD = {"alternating_current", "alternating_current_of_eq_7", "alternating_current_paper"}
"""Models whose terms cancel: rounding counts against the terms, not the sum."""


@pytest.fixture(params=CASES)
def case(request: pytest.FixtureRequest) -> Case:
    return CASES[request.param]


def test_members_of_random_boxes_lie_inside(case: Case) -> None:
    generator = np.random.default_rng(20)
    box = case.boxes(generator, BOXES)
    found = case.evaluate(box)
    for _ in range(MEMBERS):
        point = members(box, generator)
        for i in range(BOXES):
            for name, exact in case.exact(point, i).items():
                inf, sup = float(found[name].inf[i]), float(found[name].sup[i])
                assert encloses(inf, sup, exact), (name, {k: v[i] for k, v in point.items()})


@pytest.mark.parametrize("name", ["coil_energy", "energy_flow"])
def test_uncertain_time_is_enclosed(name: str) -> None:
    case = CASES[name]
    generator = np.random.default_rng(25)
    box = case.boxes(generator, 200)
    time = box["time"].inf
    box["time"] = Interval(time, time * (1.0 + generator.choice([0.0, 1e-9, 0.1], 200)))
    found = case.evaluate(box)
    for _ in range(4):
        point = members(box, generator)
        for i in range(200):
            for result, exact in case.exact(point, i).items():
                assert encloses(found[result].inf[i], found[result].sup[i], exact), result


@pytest.mark.parametrize("name", [name for name in CASES if name not in HUMPED])
def test_width_is_that_of_the_corners(name: str) -> None:
    case = CASES[name]
    generator = np.random.default_rng(21)
    box = case.boxes(generator, 40)
    found = case.evaluate(box)
    thick = [k for k, v in box.items() if np.any(v.inf < v.sup)]
    for i in range(40):
        corners = []
        for ends in itertools.product(("inf", "sup"), repeat=len(thick)):
            point = {k: v.inf for k, v in box.items()}
            point |= {k: getattr(box[k], end) for k, end in zip(thick, ends, strict=True)}
            corners.append(case.exact(point, i))
        for result, value in found.items():
            exact = [corner[result] for corner in corners]
            least, most = min(exact), max(exact)
            width, size = float(most - least), max(abs(float(least)), abs(float(most)))
            if name in SPREAD:
                size = _terms(box, i)
            ours = float(value.sup[i] - value.inf[i])
            assert ours <= width * (1.0 + 1e-9) + 40 * ULP * size + 1e-318, result


def _terms(box: dict[str, Interval], i: int) -> float:
    most = {name: float(value.sup[i]) for name, value in box.items()}
    frequency = most["voltage_frequency"] + most["frequency"]
    charge = most["voltage"] * (most["minimum_capacitance"] + most["maximum_capacitance"])
    return 4.0 * np.pi * frequency * charge


@pytest.mark.nightly
@pytest.mark.parametrize("name", sorted(HUMPED))
def test_width_is_that_of_dense_members(name: str) -> None:
    case = CASES[name]
    generator = np.random.default_rng(22)
    box = case.boxes(generator, 100)
    found = case.evaluate(box)
    reach = {k: (np.full(100, np.inf), np.full(100, -np.inf)) for k in found}
    for point in _dense(box):
        thin = case.evaluate({k: Interval(v) for k, v in point.items()})
        for k, value in thin.items():
            np.minimum(reach[k][0], value.sup, out=reach[k][0])
            np.maximum(reach[k][1], value.inf, out=reach[k][1])
    for k, value in found.items():
        width, size = reach[k][1] - reach[k][0], np.maximum(abs(value.inf), abs(value.sup))
        good = value.sup - value.inf <= width * 1.001 + 1024 * ULP * size + CANCELLED.get(k, 0.0)
        if k in {"impedance", "current"}:  # no member of a grid is right at resonance
            good |= (found["reactance"].inf <= 0.0) & (found["reactance"].sup >= 0.0)
        assert np.all(good), k


def _dense(box: dict[str, Interval]) -> Iterator[dict[str, Floats]]:
    """Members at all corners, and along every edge between them."""
    thick = [k for k, v in box.items() if np.any(v.inf < v.sup)]
    for ends in itertools.product((0.0, 1.0), repeat=len(thick)):
        share = dict(zip(thick, ends, strict=True))
        yield _at(box, share)
        for inner in thick:
            for step in np.linspace(0.02, 0.98, 33):
                yield _at(box, share | {inner: step})


def _at(box: dict[str, Interval], share: dict[str, float]) -> dict[str, Floats]:
    return {
        k: np.clip(v.inf + share.get(k, 0.0) * (v.sup - v.inf), v.inf, v.sup)
        for k, v in box.items()
    }


def test_smaller_boxes_give_smaller_results(case: Case) -> None:
    loose = _loose(case)
    generator = np.random.default_rng(23)
    box = case.boxes(generator, 2000)
    outer = case.evaluate(box)
    inner = {}
    for name, value in box.items():
        cut = np.sort(generator.uniform(0.0, 1.0, (2, 2000)), axis=0)
        width = value.sup - value.inf
        inf = np.clip(value.inf + cut[0] * width, value.inf, value.sup)
        inner[name] = Interval(inf, np.clip(value.inf + cut[1] * width, inf, value.sup))
    for name, value in case.evaluate(inner).items():
        assert np.all(outer[name].inf <= value.inf * (1.0 + loose)), name
        assert np.all(value.sup <= outer[name].sup * (1.0 + loose)), name


def _loose(case: Case) -> float:
    """An energy that has stopped to depend on a parameter still moves by its roundings."""
    return 64 * ULP if case is CASES["energy_flow"] else 0.0


def test_halves_of_a_box_make_up_the_whole(case: Case) -> None:
    loose = _loose(case)
    generator = np.random.default_rng(24)
    box = case.boxes(generator, 500)
    whole = case.evaluate(box)
    for name in box:
        value = box[name]
        middle = np.clip(0.5 * (value.inf + value.sup), value.inf, value.sup)
        first = case.evaluate(box | {name: Interval(value.inf, middle)})
        last = case.evaluate(box | {name: Interval(middle, value.sup)})
        for result, all_of_it in whole.items():
            inf = np.minimum(first[result].inf, last[result].inf)
            sup = np.maximum(first[result].sup, last[result].sup)
            slack = 600 * ULP * np.maximum(abs(all_of_it.inf), abs(all_of_it.sup))
            assert np.all(all_of_it.inf <= inf * (1.0 + loose)), (name, result)
            assert np.all(sup <= all_of_it.sup * (1.0 + loose)), (name, result)
            assert np.all(inf - all_of_it.inf <= slack + 1e-6 * (sup - inf)), (name, result)
            assert np.all(all_of_it.sup - sup <= slack + 1e-6 * (sup - inf)), (name, result)
