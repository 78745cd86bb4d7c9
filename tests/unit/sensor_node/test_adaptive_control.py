"""Adaptive control G(t): gain, trimmer and plates follow, and the truth stays inside."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from eskin_sensor_node.firmware.adaptation import QUIET, Adaptation
from eskin_sensor_node.machine.data_sheet import data_sheet
from eskin_sensor_node.node.commands import NodeControls
from hypothesis import given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st

from tests.unit.sensor_node.designs import Bench, table, taxel
from tests.unit.sensor_node.messages import (
    Samples,
    StatedPeak,
    assert_truth_is_inside,
    peaks_of,
    samples_of,
)

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from eskin.interval import Floats

LAST = 4095
MIDDLE = 2048
SLOW = 0.05  # Hz: a touch that grows for 10 s
TOO_LARGE: dict[str, Any] = {
    # Made for touches of up to 0.75 cm²: 1 cm² leaves 90 µA.
    "adc_min_A": 1.2e-4,
    "adc_max_A": 1.0e-3,
    "adc_bits": 12,
    "stimulus_Hz": SLOW,
    "area_min_m2": 1.2e-5,
    "sampling_Hz": 250.0,
    "noise": {"kind": "uniform", "bound": 1e-7},
}
WIDE: dict[str, Any] = {
    "gain_least": 0.25,
    "gain_tolerance": 1e-3,
    "trimmer_steps": 400,
    "trimmer_tolerance": 1e-3,
}
PLATES: dict[str, Any] = {"actuator_steps": 8, "actuator_step_m": 2.5e-4}


def made(folder: Path, **changes: Any) -> Bench:
    return Bench(
        folder,
        "palm",
        taxel=(table("touch", **(TOO_LARGE | changes)),),
        sampling={"stretch_ms": 200.0},
    )


def areas(bench: Bench) -> list[Samples]:
    return samples_of(bench, "t01.area")


def assert_all_hold_truth(bench: Bench) -> None:
    found = samples_of(bench)
    assert {each.channel for each in found} == {"t01.area", "t01.capacitance", "t01.energy"}
    assert_truth_is_inside(found)


def response(bench: Bench, until: float) -> tuple[Floats, Floats]:
    """Middle of each frame's mean interval, and how many of its samples are bounded."""
    found = [block for block in areas(bench) if block.ticks < until * 1e9]
    middles = [0.5 * (b.tube.values.inf.mean() + b.tube.values.sup.mean()) for b in found]
    bounded = [float(np.mean(b.tube.values.is_common_interval)) for b in found]
    return np.array(middles), np.array(bounded)


def grown(bench: Bench) -> None:
    """Let one touch grow to the whole plate and shrink again."""
    bench.run_to(20.0)
    bench.node.finish()


def test_touch_over_too_large_an_area_saturates_without_it(tmp_path: Path) -> None:
    bench = made(tmp_path)
    grown(bench)
    _, bounded = response(bench, 10.0)
    assert bounded.min() == 0.0
    assert_all_hold_truth(bench)
    bench.close()


def assert_damped(bench: Bench) -> None:
    grown(bench)
    middles, bounded = response(bench, 10.0)
    assert bounded.min() == 1.0
    # The stimulus is a raised sine that begins in its middle: a quarter period up, a half down.
    true = np.array([each.truth.mean() for each in areas(bench)])[: len(middles)]
    order = np.argsort(true)
    steps = np.diff(middles[order])
    assert steps.min() > -2e-7  # m²: trimmer and plates leave that open, of a swing of 9e-5
    assert np.ptp(middles) > 0.9 * np.ptp(true)
    assert_all_hold_truth(bench)


def test_gain_and_trimmer_keep_a_too_large_touch_unsaturated_and_monotone(tmp_path: Path) -> None:
    bench = made(tmp_path, adaptive=True, **WIDE)
    assert_damped(bench)
    bench.close()


def test_plates_that_move_apart_keep_it_unsaturated_and_monotone(tmp_path: Path) -> None:
    bench = made(tmp_path, adaptive=True, gain_most=1.0, **PLATES)
    chosen = bench.node.taxels[0].control_unit.adaptation
    seen = set()
    while bench.ticks < 20e9:
        bench.run_to(bench.ticks / 1e9 + 0.2)
        seen.add(chosen.plate)
    assert len(seen) > 3
    assert_damped(bench)
    bench.close()


def test_quiet_rest_is_measured_more_finely(tmp_path: Path) -> None:
    widths = []
    for name, on in (("off", False), ("on", True)):
        bench = made(tmp_path / name, adaptive=on, stimulus_Hz=1e-4, adc_bits=8, **WIDE)
        bench.run_to(10.0)
        last = samples_of(bench, "t01.capacitance")[-1]
        widths.append(float(np.median(last.tube.values.wid)))
        assert_all_hold_truth(bench)
        bench.close()
    assert widths[1] < 0.5 * widths[0]


def test_sustained_contact_is_never_erased(tmp_path: Path) -> None:
    """With G(t), trimmer, plates and drift compensation: a contact stays as large as it was."""
    bench = made(tmp_path, adaptive=True, **WIDE, **PLATES)
    bench.run_to(14.9)
    bench.node.taxels[0].control_unit.calibrate()
    bench.run_to(15.0)  # the stimulus' trough
    # From its crest on the stimulus all but stands still: a contact that stays.
    world: Any = bench.node.taxels[0].group.sensing.world
    world._stimulus = 1e-9
    world._least = world._most
    unit = bench.node.taxels[0].control_unit.units[0]
    rest = unit.baseline.lo, unit.baseline.hi
    bench.run_to(120.0)
    held = areas(bench)[-1]
    assert np.all(held.tube.values.contains(world._most))
    assert float(held.tube.values.inf.min()) > 9e-5
    assert unit.maybe_touched  # by more than the threshold of 0.4 cm²
    assert (unit.baseline.lo, unit.baseline.hi) == rest  # area does not depend on the plates
    assert_all_hold_truth(bench)
    bench.close()


def test_changes_of_gain_and_trimmer_make_no_peaks(tmp_path: Path) -> None:
    said: list[list[StatedPeak]] = []
    for name, on in (("off", False), ("on", True)):
        bench = made(tmp_path / name, adaptive=on, adc_min_A=0.0, stimulus_Hz=0.2, **WIDE)
        bench.run_to(22.0)
        said.append([peak for peak in peaks_of(bench, "t01.area") if peak.count == (1, 1)])
        bench.close()
    assert len(said[0]) == len(said[1]) > 2


CHANGES = st.fixed_dictionaries(
    {
        "gain_least": st.sampled_from([0.125, 0.5, 1.0]),
        "gain_most": st.sampled_from([1.0, 4.0, 64.0]),
        "gain_tolerance": st.sampled_from([0.0, 1e-2]),
        "trimmer_steps": st.sampled_from([0, 3, 500]),
        "trimmer_step": st.sampled_from([0.01, 0.3]),
        "trimmer_tolerance": st.sampled_from([0.0, 1e-3, 0.1]),
        "actuator_steps": st.sampled_from([0, 5]),
        "actuator_step_tolerance": st.sampled_from([0.0, 0.1]),
        "adc_min_A": st.sampled_from([0.0, 3e-4]),
        "adc_bits": st.sampled_from([6, 12]),
        "stimulus_Hz": st.sampled_from([0.1, 1.0]),
    }
)


@hypothesis_settings(max_examples=25, deadline=None)
@given(CHANGES, st.integers(0, 1000))
def test_truth_is_inside_through_every_change(
    tmp_path_factory: Any, changes: Mapping[str, Any], seed: int
) -> None:
    folder = tmp_path_factory.mktemp("adaptive")
    bench = made(folder, adaptive=True, **changes)
    bench.ticks = seed * 10_000_000  # an overrun: the stimulus begins anywhere
    bench.node.advance(bench.ticks)
    bench.run_to(bench.ticks / 1e9 + 4.0)
    assert_all_hold_truth(bench)
    bench.close()


def control(**changes: Any) -> Adaptation:
    return Adaptation(data_sheet(taxel("capacitive", **(WIDE | changes))))


@given(st.lists(st.lists(st.integers(0, LAST), min_size=1, max_size=9), max_size=30))
def test_codes_near_an_end_lower_the_gain_before_the_next_frame(frames: list[list[int]]) -> None:
    chosen = control(gain_least=2.0**-6)
    for codes in frames:
        before, trim = chosen.gain, chosen.trim
        chosen.adapt([codes], len(codes), rests=False)
        if max(codes) >= LAST * 15 // 16 + 1:
            assert chosen.gain < before or before == 2.0**-6
        assert chosen.gain <= 2.0 * before
        assert trim == chosen.trim or chosen.gain != before


def test_gain_rises_only_after_quiet_frames_and_does_not_flutter() -> None:
    chosen = control()
    gains = []
    for _ in range(10 * QUIET):
        chosen.adapt([[MIDDLE, MIDDLE + 3]], 2, rests=False)
        gains.append(chosen.gain)
    assert gains[: QUIET - 1] == [1.0] * (QUIET - 1)
    assert gains[QUIET - 1] == 2.0
    assert gains[-1] == 8.0
    assert gains == sorted(gains)


def test_trimmer_follows_the_rest_and_no_contact() -> None:
    chosen = control()
    for _ in range(QUIET * 4):
        chosen.adapt([[3000]], 1, rests=False)
    assert chosen.trim == 0
    chosen.adapt([[3000]], 1, rests=True)
    assert chosen.trim > 0


def test_command_switches_it_and_state_has_the_gain(tmp_path: Path) -> None:
    bench = made(tmp_path, stimulus_Hz=1e-4, **WIDE)
    controls = NodeControls(bench.node)
    assert controls.restore({})["t01"]["adaptive"] == "off"
    assert controls.apply("set", {"adaptive": "on"})["t01"]["adaptive"] == "on"
    bench.run_to(10.0)
    state = controls.apply("calibrate", {})
    assert float(state["t01"]["gain"]) > 1.0
    off = controls.apply("set", {"adaptive": "off", "gain": 1.5})["t01"]
    assert (off["adaptive"], off["gain"]) == ("off", 1.5)
    bench.run_to(12.0)
    assert bench.node.taxels[0].control_unit.adaptation.trim == 0
    assert controls.apply("reset", {})["t01"]["gain"] == 1.0
    assert_all_hold_truth(bench)
    bench.close()


def test_rest_follows_plates_that_move(tmp_path: Path) -> None:
    bench = made(tmp_path, stimulus_Hz=1e-4, **PLATES)
    unit = bench.node.taxels[0].control_unit
    unit.calibrate()
    bench.run_to(1.0)
    area, capacitance = (unit.units[k].baseline for k in (0, 1))
    before = area.lo, capacitance.lo
    unit.adaptation.plate = 4  # from 1 to 2 mm
    unit._adjust(0)
    assert area.lo == before[0]
    assert 0.49 < capacitance.lo / before[1] < 0.5
    bench.close()
