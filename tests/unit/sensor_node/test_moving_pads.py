"""Pads whose plates an actuator moves apart: what presses them stays inside."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from eskin_sensor_node.kinds.generator import ColumnGenerator
from eskin_sensor_node.kinds.pad import PadWorld
from eskin_sensor_node.world.scenario.file import scenario_text
from hypothesis import given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st

from eskin.wire.messages import ResetCause
from tests.unit.sensor_node.designs import SECOND, Bench, table, taxel
from tests.unit.sensor_node.messages import Samples, samples_of

if TYPE_CHECKING:
    from pathlib import Path

    from eskin.interval import Floats

STRETCH = 200.0
PLATES: dict[str, Any] = {"adaptive": True, "gain_most": 1.0, "actuator_steps": 6}
TIGHT: dict[str, Any] = {
    # 0.83 mA at rest, 0.73 mA at the height of the scenario's press on t10.
    "place": "t10",
    "adc_min_A": 7.8e-4,
    "adc_max_A": 1.3e-3,
    "actuator_step_m": 5e-5,
    "thermometer": None,
    "hygrometer": None,
}
QUANTITIES = {"capacitance", "current", "plate_distance", "contact_area", "pressure"}


def made(folder: Path, **changes: Any) -> Bench:
    return Bench(
        folder,
        "hand",
        taxel=(table("pad", **(TIGHT | changes)),),
        sampling={"stretch_ms": STRETCH},
    )


def checked(bench: Bench) -> dict[str, list[Samples]]:
    """All samples by quantity, after a look at the truth inside of them."""
    found: dict[str, list[Samples]] = {}
    for each in samples_of(bench):
        assert each.hold_truth(), each.channel
        found.setdefault(each.channel.partition(".")[2], []).append(each)
    return found


def bounded(found: list[Samples]) -> float:
    return float(np.mean([np.mean(each.tube.values.is_common_interval) for each in found]))


def test_plates_of_a_pad_move_apart_and_keep_a_hard_press_unsaturated(tmp_path: Path) -> None:
    shares = []
    for name, changes in (("fixed", {}), ("moving", PLATES)):
        bench = made(tmp_path / name, **changes)
        seen = set()
        while bench.ticks < 7 * SECOND:
            bench.run_to(bench.ticks / SECOND + 0.2)
            seen.add(bench.node.taxels[0].control_unit.adaptation.plate)
        found = checked(bench)
        assert set(found) == QUANTITIES
        shares.append(bounded(found["pressure"]))
        assert (len(seen) > 2) == (name == "moving")
        bench.close()
    assert shares[0] < 0.9
    assert shares[1] > 0.99


CHANGES = st.fixed_dictionaries(
    {
        "actuator_step_m": st.sampled_from([1e-5, 1e-4, 1e-3]),
        "actuator_step_tolerance": st.sampled_from([0.0, 2e-3, 0.3]),
        "plate_distance_tolerance": st.sampled_from([0.0, 0.01]),
        "gain_least": st.sampled_from([0.25, 1.0]),
        "gain_most": st.sampled_from([1.0, 16.0]),
        "trimmer_steps": st.sampled_from([0, 50]),
        "adc_min_A": st.sampled_from([0.0, 7.8e-4, 8.2e-4]),
        "elasticity_tolerance": st.sampled_from([0.0, 0.05]),
        "place": st.sampled_from(["t05", "t06", "t10"]),
    }
)


@hypothesis_settings(max_examples=15, deadline=None)
@given(CHANGES, st.integers(0, 2000), st.lists(st.integers(0, 6), min_size=4, max_size=4))
def test_truth_is_inside_wherever_the_plates_stand(
    tmp_path_factory: Any, changes: dict[str, Any], begin: int, steps: list[int]
) -> None:
    bench = made(tmp_path_factory.mktemp("pads"), **(PLATES | changes))
    bench.ticks = begin * SECOND // 100  # an overrun: anything may happen at first
    bench.node.advance(bench.ticks)
    each = bench.node.taxels[0]
    for step in steps:
        before = each.control_unit.adaptation.plate
        each.control_unit.adaptation.plate = step
        each.control_unit._adjust(before)
        each._adjust()
        bench.run_to(bench.ticks / SECOND + 0.4)
    assert set(checked(bench)) == QUANTITIES
    bench.close()


def test_rest_of_each_quantity_follows_plates_that_move(tmp_path: Path) -> None:
    bench = made(tmp_path, adc_min_A=0.0, adc_max_A=4e-3, **(PLATES | {"adaptive": False}))
    unit = bench.node.taxels[0].control_unit
    unit.calibrate()
    bench.run_to(0.4)
    rests = {each.name.partition(".")[2]: each.baseline for each in unit.units}
    before = {quantity: rest.hi for quantity, rest in rests.items()}
    unit.adaptation.plate = 4  # from 1 to 1.2 mm
    unit._adjust(0)
    ratios = {quantity: rest.hi / before[quantity] for quantity, rest in rests.items()}
    assert ratios["capacitance"] == pytest.approx(1 / 1.2, rel=5e-3)
    assert ratios["current"] == pytest.approx(1.2, rel=5e-3)
    assert ratios["plate_distance"] == pytest.approx(1.2, rel=5e-3)
    assert ratios["pressure"] == ratios["contact_area"] == 1.0
    bench.close()


def test_plates_and_gain_are_those_of_the_design_after_a_reset(tmp_path: Path) -> None:
    bench = made(tmp_path, **(PLATES | {"gain_least": 0.5}))
    bench.run_to(5.0)
    assert bench.node.taxels[0].control_unit.adaptation.plate > 0
    bench.node.machine.reset(ResetCause.BROWN_OUT)
    bench.run_to(6.0)
    assert {each.position.boot for each in checked(bench)["pressure"]} == {1, 2}
    bench.close()


def test_stuck_pad_keeps_its_capacitance_while_its_plates_move(tmp_path: Path) -> None:
    scene = tmp_path / "stuck.toml"
    fault = '\n[[fault]]\ntaxel = "t10"\nkind = "stuck"\nat_s = 4.5\n'
    scene.write_text(scenario_text("hand.toml") + fault)
    design = taxel("pad", scenario=str(scene), place="t10", actuator_steps=3)
    world = PadWorld(design, ColumnGenerator(3, 0), ["t10"])  # type: ignore[arg-type]  # it is a pad

    def capacitance(second: float) -> Floats:
        return world.truth(np.array([second]))[0]["capacitance"]

    world.move(2)
    kept = capacitance(4.6)
    world.move(0)
    assert capacitance(5.0) == kept
    assert capacitance(4.4) != kept
