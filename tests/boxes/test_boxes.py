"""A short form of ``python -m tests.boxes``, and boxes that were once violated."""

from __future__ import annotations

from typing import TYPE_CHECKING

import flint
import numpy as np
import pytest

from eskin import models
from eskin.interval import Interval as X
from eskin.models import icm
from tests.boxes.draw import members
from tests.boxes.models import EVERY
from tests.boxes.verify import BITS, Verdict, hold, verify

if TYPE_CHECKING:
    from collections.abc import Iterator

SLOW = {"magfes_current", "ecfes_voltage", "energy_flow"}


@pytest.fixture(autouse=True)
def _many_bits() -> Iterator[None]:
    before, flint.ctx.prec = flint.ctx.prec, BITS
    yield
    flint.ctx.prec = before


@pytest.mark.parametrize("model", EVERY)
def test_members_of_hostile_boxes_lie_inside(model: str) -> None:
    found = verify(model, count=60 if model in SLOW else 150, seed=7)
    assert found.violations == []
    assert found.points > 100


def test_value_outside_is_found() -> None:
    """The check can fail: a member is held against an enclosure that is too narrow."""
    verdict = Verdict("rc_frequency")
    box = {"resistance": X([1.0], [2.0]), "capacitance": X([1.0], [2.0])}
    point = {"resistance": flint.arb(1), "capacitance": flint.arb(1)}
    hold(verdict, box, {"value": X([0.1], [0.15])}, point)
    assert len(verdict.violations) == 1
    assert 0.05 < verdict.worst < 0.1


CIRCUITS = {
    "ecfes_voltage": {"capacitor_resistance": X([4e3], [5e3]), "capacitance": X([1.5e-6])},
    "magfes_current": {"coil_resistance": X([1.0], [2.0]), "inductance": X([4e-3], [9e-3])},
}


@pytest.mark.parametrize("model", CIRCUITS)
@pytest.mark.parametrize("frequency", [X([0.0]), X([1e-40]), X([0.0], [1e-40])])
def test_direct_voltage_of_uncertain_phase_is_enclosed(model: str, frequency: X) -> None:
    """At f = 0 the response is sin ψ·(1 - e^(-t/τ)), which rises with ψ here."""
    box = CIRCUITS[model] | {
        "amplitude": X([1.0]),
        "frequency": frequency,
        "phase": X([0.4], [1.4]),
    }
    box["time"] = X([5e-3])
    found = EVERY[model].evaluate(box)
    verdict = Verdict(model)
    points = members(box, 0, np.random.default_rng(1), 100)
    for point in points:
        hold(verdict, box, found, point)
    assert verdict.violations == []
    reached = [float(EVERY[model].truth(point)["value"]) for point in points]
    width = float(found["value"].sup[0] - found["value"].inf[0])
    assert width <= 1.05 * np.ptp(reached)


def test_extremes_beyond_2_to_the_63_turns_are_reached() -> None:
    capacitance = models.harmonic_capacitance(
        X(0, 1e19), minimum_capacitance=1e-12, maximum_capacitance=2e-12, frequency=1.0
    )
    assert capacitance.inf <= 1e-12
    assert capacitance.sup >= 2e-12
    voltage = models.oscillation_paper(X(0.1, 1.001), voltage=5.0, frequency=X(1, 1e20))
    assert voltage.inf == -5.0
    assert voltage.sup == 5.0
    source = icm.source_voltage(1.0, amplitude=1.0, frequency=X(1e19, 2e19), phase=0.0)
    assert source.inf == pytest.approx(-1.0)
    assert source.sup == pytest.approx(1.0)
