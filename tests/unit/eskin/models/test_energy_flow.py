"""What the supercapacitor gives is stored or lost, for every draw of the parameters."""

from __future__ import annotations

from dataclasses import fields
from typing import TYPE_CHECKING

import numpy as np
import pytest
from flint import arb

from eskin import models
from eskin.interval import Interval
from eskin.models.charging import BURNT_PEAK, FILLED_PEAK, burnt, drawn, filled
from tests.unit.eskin.models import truth
from tests.unit.eskin.models.cases import CASES, members

if TYPE_CHECKING:
    from collections.abc import Callable

CASE = CASES["energy_flow"]
DRAWS = 20_000


def _draws(box: dict[str, Interval], n: int, seed: int) -> dict[str, Interval]:
    generator = np.random.default_rng(seed)
    wide = {k: Interval(np.full(n, v.inf), np.full(n, v.sup)) for k, v in box.items()}
    return {k: Interval(v) for k, v in members(wide, generator).items()}


def _box() -> dict[str, Interval]:
    return {
        "voltage": Interval(0.9, 1.1),
        "switch_resistance": Interval(0.05, 2.0),
        "coil_resistance": Interval(4.0, 6.0),
        "inductance": Interval(9e-3, 11e-3),
        "capacitor_resistance": Interval(90.0, 110.0),
        "capacitance": Interval(0.9e-6, 1.1e-6),
    }


@pytest.mark.parametrize("time", [0.0, 1e-7, 1e-4, 1e-3, 2.5e-3, 1.0])
def test_balance_holds_for_every_draw_and_all_lie_inside(time: float) -> None:
    box = _box()
    whole = models.energy_flow(time, **box)
    draw = models.energy_flow(time, **_draws(box, DRAWS, 40))
    out = draw.stored + draw.loss
    assert np.all(draw.supplied.inf <= out.sup)
    assert np.all(out.inf <= draw.supplied.sup)
    parts = draw.switch_loss + draw.coil_loss + draw.capacitor_loss
    assert np.all((parts.inf <= draw.loss.sup) & (draw.loss.inf <= parts.sup))
    held = draw.magnetic + draw.electric
    assert np.all((held.inf <= draw.stored.sup) & (draw.stored.inf <= held.sup))
    for field in fields(whole):
        one, all_of_it = getattr(draw, field.name), getattr(whole, field.name)
        assert np.all(one.sup - one.inf <= 1e-12 * one.sup), field.name
        assert np.all((all_of_it.inf <= one.mid) & (one.mid <= all_of_it.sup)), field.name


def test_balance_holds_to_sixty_digits() -> None:
    generator = np.random.default_rng(41)
    box = CASE.boxes(generator, 200)
    point = members(box, generator)
    for i in range(200):
        exact = truth.energy_flow({k: arb(float(v[i])) for k, v in point.items()})
        assert (exact["supplied"] - exact["stored"] - exact["loss"]).contains(0)


def test_coil_at_rest_burns_what_ohms_law_says() -> None:
    found = models.energy_flow(
        1.0,
        voltage=2.0,
        switch_resistance=1.0,
        coil_resistance=3.0,
        inductance=1e-6,
        capacitor_resistance=1.0,
        capacitance=1e-9,
    )
    assert found.switch_loss.mid == pytest.approx(0.25, rel=1e-5)
    assert found.coil_loss.mid == pytest.approx(0.75, rel=1e-5)
    assert found.magnetic.mid == pytest.approx(0.5 * 1e-6 * 0.25, rel=1e-9, abs=0.0)
    assert found.electric.mid == pytest.approx(2e-9, rel=1e-9, abs=0.0)
    assert found.capacitor_loss.mid == pytest.approx(2e-9, rel=1e-9, abs=0.0)


@pytest.mark.parametrize("result", ["magnetic", "electric", "switch_loss", "coil_loss", "loss"])
def test_maximum_inside_the_box_is_found(result: str) -> None:
    box = {
        "voltage": Interval(1.0),
        "switch_resistance": Interval(0.01, 100.0),
        "coil_resistance": Interval(0.01, 100.0),
        "inductance": Interval(1e-6 if result == "magnetic" else 1e-4, 1.0),
        "capacitor_resistance": Interval(1.0),
        "capacitance": Interval(1e-9, 1.0),
    }
    whole = getattr(models.energy_flow(1e-3, **box), result)
    # The peak lies on an edge: all other parameters at the end that gives most.
    ends = {k: v.inf for k, v in box.items()}
    swept = {
        "magnetic": "inductance",
        "electric": "capacitance",
        "switch_loss": "switch_resistance",
        "coil_loss": "coil_resistance",
        "loss": "coil_resistance",
    }[result]
    along = np.exp(np.linspace(np.log(box[swept].inf), np.log(box[swept].sup), 200_001))
    if result == "loss":  # the capacitor burns most at its greatest
        ends["capacitance"] = box["capacitance"].sup
    peak = getattr(models.energy_flow(1e-3, **ends | {swept: along}), result)
    best = int(np.argmax(peak.mid))
    assert 0 < best < along.size - 1
    assert whole.sup >= peak.inf.max()
    assert whole.sup <= peak.sup.max() * (1.0 + 1e-8)


def test_parts_of_charging_are_within_their_roundings() -> None:
    for x in np.concatenate([10.0 ** np.linspace(-20.0, 20.0, 801), np.linspace(0.9, 1.1, 101)]):
        y = arb(float(x))
        p = -(-y).expm1()
        exact = [(p / y) ** 2, (y - p) / y**2, (y - p - p * p / 2) / y**3]
        if x < 1e-3:  # here the formulas lose more than 200 bits hold
            exact[1] = arb(0.5) - y / 6 + y * y / 24 - y**3 / 120
            exact[2] = arb(1) / 3 - y / 4 + arb(7) * y * y / 60 - y**3 / 24
        for value, right in zip((filled(x), drawn(x), burnt(x)), exact, strict=True):
            assert abs(arb(float(value)) / right - 1) < 16 * 2.0**-53 + float(x) ** 4 * (x < 1e-3)


@pytest.mark.parametrize(
    ("peak", "size"),
    [(FILLED_PEAK, lambda x: x * filled(x)), (BURNT_PEAK, lambda x: x * burnt(x))],
)
def test_peaks_of_charging_are_where_they_are_said_to_be(
    peak: float, size: Callable[[float], float]
) -> None:
    for step in (1e-6, 1e-3, 0.5):
        assert size(peak) > size(peak - step)
        assert size(peak) > size(peak + step)
    rising = [size(x) for x in np.linspace(1e-3, peak, 2000)]
    falling = [size(x) for x in np.linspace(peak, 60.0, 2000)]
    assert np.all(np.diff(rising) > 0.0)
    assert np.all(np.diff(falling) < 0.0)
