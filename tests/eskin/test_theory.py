"""The page on theory says what is true."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np

import eskin
from eskin.design import Region

PAGE = Path(__file__).parents[2] / "docs" / "theory.md"


def test_examples_run_and_give_what_the_page_says() -> None:
    names: dict[str, Any] = {}
    for code in re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.DOTALL):
        exec(compile(code, str(PAGE), "exec"), names)  # noqa: S102 - our own documentation
    x = names["X"]
    assert (x(1, 2) + x(3, 4)).equal(x(4, 6))
    assert (x(1, 2) / x(0, 4)).equal(x(0.25, np.inf))
    assert (x(1, 3) < x(2, 4)).possible
    paving = names["paving"]
    assert paving.region(distance=2e-3, permittivity=4.5) is Region.CERTAIN
    assert paving.region(distance=4e-3, permittivity=4.0) is Region.NEVER


def response(time_constant: Any, time: float, phase: float) -> Any:
    omega = 100.0 * np.pi
    x, angle = omega * time_constant, omega * time + phase
    start = np.sin(phase) - x * np.cos(phase)
    return (np.sin(angle) - x * np.cos(angle) - start * np.exp(-time / time_constant)) / (1 + x * x)


def test_widths_of_the_three_methods_are_those_of_the_table() -> None:
    phase, time = np.radians(-46.0), 3e-3
    resistance, capacitance = (
        eskin.Interval.relative(2419.0, 0.2),
        eskin.Interval.relative(1e-6, 0.2),
    )
    tau = resistance * capacitance
    exact = response(np.linspace(float(tau.inf), float(tau.sup), 400_001), time, phase)
    true = float(np.ptp(exact))
    corners = float(np.ptp(exact[[0, -1]]))
    naive = float(response(tau, time, phase).wid)
    ours = eskin.models.icm.ecfes_voltage(
        time,
        amplitude=1.0,
        frequency=50.0,
        phase=phase,
        capacitor_resistance=resistance,
        capacitance=capacitance,
    )
    assert round(naive / true) == 53
    assert round(corners / true, 2) == 0.52
    assert 1.0 <= float(ours.wid) / true < 1.00001
