"""Random boxes of every model, few of them; and what such a comparison must find."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest

from eskin.interval import Interval
from eskin.models import icm
from tests.robustness.boxes.cases import CASES, Case
from tests.robustness.boxes.verify import Outcome, compare, verify

FEW = 5


@pytest.mark.parametrize("name", CASES)
def test_members_of_awkward_boxes_lie_inside(name: str) -> None:
    outcome = verify(name, FEW, seed=1)
    assert outcome.boxes == FEW
    assert outcome.violations == 0, outcome.examples


def _outcome(case: Case, **box: tuple[float, float]) -> Outcome:
    outcome = Outcome("")
    boxes = {name: Interval([lo], [hi]) for name, (lo, hi) in box.items()}
    compare(case, boxes, np.random.default_rng(2), outcome)
    return outcome


def _at_the_ends(**box: Interval) -> Interval:
    """As if a sine had its extremes at the ends of time."""
    ends = [CASES["oscillation_paper"].call(**{**box, "time": t}) for t in _ends(box["time"])]
    return Interval(np.minimum(*(e.inf for e in ends)), np.maximum(*(e.sup for e in ends)))


def _ends(value: Interval) -> tuple[Interval, Interval]:
    return Interval(value.inf), Interval(value.sup)


@pytest.mark.parametrize("time", [(0.1, 0.4), (0.0, 1e19)])
def test_a_missed_crest_is_found(time: tuple[float, float]) -> None:
    case = dataclasses.replace(CASES["oscillation_paper"], call=_at_the_ends)
    assert _outcome(case, voltage=(1.0, 1.0), frequency=(1.0, 1.0), time=time).violations == 1


def test_a_missed_phase_is_found() -> None:
    def middle(time: Any, phase: Interval, **others: Any) -> Interval:
        return icm.ecfes_voltage(time, phase=phase.mid, **others)

    case = dataclasses.replace(CASES["icm.ecfes_voltage"], call=middle)
    outcome = _outcome(
        case, amplitude=(1.0, 1.0), frequency=(0.0, 0.0), phase=(0.4, 1.4), time=(5e-3, 5e-3),
        capacitor_resistance=(4e3, 5e3), capacitance=(1.5e-6, 1.5e-6),
    )  # fmt: skip
    assert outcome.violations == 1


def test_a_result_that_is_no_interval_is_found() -> None:
    def nothing(**box: Interval) -> Interval:
        return Interval.empty(box["inductance"].inf.shape)

    case = dataclasses.replace(CASES["lc_frequency"], call=nothing)
    assert _outcome(case, inductance=(1.0, 1.0), capacitance=(1.0, 1.0)).violations == 1


@pytest.mark.parametrize("model", ["icm.ecfes_voltage", "icm.magfes_current"])
@pytest.mark.parametrize("frequency", [(0.0, 0.0), (1e-40, 1e-40), (0.0, 1e-40)])
def test_direct_voltage_of_uncertain_phase_is_enclosed(
    model: str, frequency: tuple[float, float]
) -> None:
    """At f = 0 the response is sin ψ·(1 - e^(-t/τ)), which rises with ψ here."""
    circuit = {
        "icm.ecfes_voltage": {"capacitor_resistance": (4e3, 5e3), "capacitance": (1.5e-6, 1.5e-6)},
        "icm.magfes_current": {"coil_resistance": (1.0, 2.0), "inductance": (4e-3, 9e-3)},
    }[model]
    outcome = _outcome(
        CASES[model], amplitude=(1.0, 1.0), frequency=frequency, phase=(0.4, 1.4),
        time=(5e-3, 5e-3), **circuit,
    )  # fmt: skip
    assert outcome.violations == 0, outcome.examples


def test_extremes_beyond_2_to_the_63_turns_are_reached() -> None:
    source = icm.source_voltage(1.0, amplitude=1.0, frequency=Interval(1e19, 2e19), phase=0.0)
    assert source.inf <= -1.0
    assert source.sup >= 1.0
