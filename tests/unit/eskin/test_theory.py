"""The page on theory says what is true."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

import eskin
from eskin.design import All, Region, invert
from eskin.figures.touch_design import touch_design

PAGE = Path(__file__).parents[3] / "docs" / "theory.md"


def test_examples_run_and_give_what_the_page_says() -> None:
    names: dict[str, Any] = {}
    for code in re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.DOTALL):
        exec(compile(code, str(PAGE), "exec"), names)  # noqa: S102 - our own documentation
    first = re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.DOTALL)[0]
    shown = re.findall(r"^(X\(.*?)  # ([^:\n]*)", first, re.MULTILINE)
    assert len(shown) == 5
    for expression, result in shown:
        assert str(eval(expression, names)) == result  # noqa: S307 - our own documentation
    paving = names["paving"]
    assert paving.region(distance=2e-3, permittivity=4.5) is Region.CERTAIN
    assert paving.region(distance=4e-3, permittivity=4.0) is Region.NEVER
    # The picture below the example is of the same paving.
    drawn = touch_design()
    assert np.array_equal(drawn.regions, paving.regions)
    assert np.array_equal(drawn.lo, paving.lo)
    wanted = names["wanted"].parts
    plain = All((wanted[0], replace(wanted[1], expression=False)))
    many = invert(plain, names["space"], resolution=1 / 512)
    assert len(paving.lo) < 0.1 * len(many.lo)


def response(time_constant: Any, time: float, phase: float) -> Any:
    omega = 100.0 * np.pi
    x, angle = omega * time_constant, omega * time + phase
    start = np.sin(phase) - x * np.cos(phase)
    return (np.sin(angle) - x * np.cos(angle) - start * np.exp(-time / time_constant)) / (1 + x * x)


RESISTANCE, CAPACITANCE = (
    eskin.Interval.relative(2419.0, 0.2),
    eskin.Interval.relative(1e-6, 0.2),
)


def widths(phase: float, time: float) -> dict[str, float]:
    """Of each method, in units of the true width."""
    tau = RESISTANCE * CAPACITANCE
    exact = response(np.linspace(float(tau.inf), float(tau.sup), 400_001), time, phase)
    corners = [response(2419e-6 * a * b, time, phase) for a, b in product((0.8, 1.2), repeat=2)]
    ours = eskin.models.icm.ecfes_voltage(
        time,
        amplitude=1.0,
        frequency=50.0,
        phase=phase,
        capacitor_resistance=RESISTANCE,
        capacitance=CAPACITANCE,
    )
    found = {
        "naive": float(response(tau, time, phase).wid),
        "corners": float(np.ptp(corners)),
        "extremes": float(np.ptp(exact[[0, -1]])),
        "ours": float(ours.wid),
    }
    return {name: width / float(np.ptp(exact)) for name, width in found.items()}


def test_widths_of_the_methods_are_those_of_the_table() -> None:
    found = widths(np.radians(-46.0), 3e-3)
    page = PAGE.read_text()
    rows = {
        f"| interval arithmetic on the formula as printed | {found['naive']:.0f} |",
        f"| the corners of the box of parameters | {found['corners']:.3f}: **not an enclosure** |",
        f"| its two extreme corners alone | {found['extremes']:.2f}: even less |",
    }
    for row in rows:
        assert row in page
    assert 1.0 <= found["ours"] < 1.000001
    assert "| eskin | 1.000001 |" in page
    naive = widths(0.0, 1e-4)["naive"]
    assert f"even {round(naive, -2):.0f} times too wide" in page


def test_voltage_turns_where_the_page_says() -> None:
    share = np.linspace(0.64, 1.44, 400_001)
    voltage = response(2419e-6 * share, 3e-3, np.radians(-46.0))
    assert f"τ = {share[np.argmin(voltage)]:.3f} of its nominal value" in PAGE.read_text()


def test_thin_responses_are_as_narrow_as_the_page_says() -> None:
    voltage = eskin.models.icm.ecfes_voltage(
        np.linspace(0.0, 20e-3, 100_000),
        amplitude=5.0,
        frequency=50.0,
        phase=np.radians(-46.0),
        capacitor_resistance=2419.0,
        capacitance=1e-6,
    )
    apart = (voltage.sup - voltage.inf) / np.spacing(voltage.mag)
    assert np.percentile(apart, 50.0) <= 1.0
    assert np.percentile(apart, 98.0) <= 3.0
    assert "one float apart at the median, and at most three in 98 of 100" in PAGE.read_text()


def test_misses_within_six_deviations_are_as_rare_as_the_page_on_intervals_says() -> None:
    page = (PAGE.parent / "intervals.md").read_text()
    assert "for k = 6 one in 500 million misses" in " ".join(page.split())
    assert 4.5e8 < 1.0 / math.erfc(6.0 / math.sqrt(2.0)) < 5.5e8
