"""Physical constants against CODATA, as scipy has it and as it follows from the exact ones."""

from __future__ import annotations

import ast
from pathlib import Path

import mpmath
import pytest
from scipy import constants as codata

import eskin
from eskin import models
from eskin.constants import PAPER_VACUUM_PERMITTIVITY, TWO_PI, VACUUM_PERMITTIVITY
from eskin.noise import GaussianNoise, touch_within

ROOT = Path(__file__).parents[3]
VALUE, _, UNCERTAINTY = codata.physical_constants["vacuum electric permittivity"]


def test_vacuum_permittivity_holds_codata_2022_and_the_values_before_it() -> None:
    # CODATA 2018 and, before 2019, the exact 1/(µ0·c²) with µ0 = 4π·1e-7.
    for value in (VALUE - 6 * UNCERTAINTY, VALUE, VALUE + 6 * UNCERTAINTY, 8.8541878128e-12):
        assert VACUUM_PERMITTIVITY.contains(value)
    assert VACUUM_PERMITTIVITY.contains(float(1 / (4e-7 * mpmath.pi * 299792458**2)))
    assert VACUUM_PERMITTIVITY.wid < 25 * UNCERTAINTY
    assert not VACUUM_PERMITTIVITY.contains(PAPER_VACUUM_PERMITTIVITY)


def test_vacuum_permittivity_follows_from_the_fine_structure_constant() -> None:
    e, h, c = (codata.physical_constants[name][0] for name in (
        "elementary charge", "Planck constant", "speed of light in vacuum"))  # fmt: skip
    alpha = codata.physical_constants["fine-structure constant"][0]
    assert VACUUM_PERMITTIVITY.contains(e**2 / (2.0 * alpha * h * c))


def test_two_pi_is_enclosed_by_neighbours() -> None:
    with mpmath.workprec(200):
        assert mpmath.mpf(float(TWO_PI.inf)) < 2 * mpmath.pi < mpmath.mpf(float(TWO_PI.sup))
    assert TWO_PI.wid == 2.0**-50


@pytest.mark.parametrize("area", [1.0, eskin.Interval(1.0, 2.0)])
def test_every_model_holds_a_plate_in_a_vacuum(area: float | eskin.Interval) -> None:
    plate = {"distance": 1.0, "relative_permittivity": 1.0}
    sine = {"frequency": 1.0, "relative_permittivity": 1.0}
    found = [
        models.capacitance(area=area, **plate),
        models.formulas.capacitance(area=eskin.Interval(1.0) * area, **plate),
        models.touch_of_area(area, voltage=0.0, **plate).capacitance,
        models.touch(
            0.3, minimum_area=area, maximum_area=area, distance=1.0, voltage=0.0, **sine
        ).capacitance,
        models.moving_plate(
            0.3, area=area, minimum_distance=1.0, maximum_distance=1.0, **sine
        ).capacitance,
        touch_within(
            area, distance=1.0, voltage=0.0, noise=GaussianNoise(), deviations=1.0
        )[0].capacitance,
    ]  # fmt: skip
    for capacitance in found:
        assert capacitance.contains(VALUE)


def test_no_source_takes_the_paper_s_value_but_by_its_name() -> None:
    found = []
    for room in ("eskin", "sensor_node", "gateway", "cloud", "ca_service"):
        for path in (ROOT / room).rglob("*.py"):
            for node in ast.walk(ast.parse(path.read_text())):
                value = node.value if isinstance(node, ast.Constant) else None
                if isinstance(value, float) and value != 0.0 and abs(value / VALUE - 1.0) < 1e-2:
                    found.append((path.relative_to(ROOT).as_posix(), value))
    assert {path for path, _ in found} == {"eskin/constants.py"}
