"""What is set of a node while it runs: gain, rate, mode, smoothing, threshold, rest."""

from __future__ import annotations

from fractions import Fraction
from typing import TYPE_CHECKING

import numpy as np
import pytest
from eskin_sensor_node.firmware.channel import ADAPTIVE, PEAKS, Baseline, Smoothing
from hypothesis import given
from hypothesis import strategies as st

from eskin.union_bound import union_coverage
from tests.unit.sensor_node.designs import SECOND, Bench
from tests.unit.sensor_node.messages import Samples, peaks_of, samples_of

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from eskin_sensor_node.node.taxel import EmulatedTaxel


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Bench]:
    made = Bench(tmp_path, "palm")
    yield made
    made.close()


def first(bench: Bench) -> EmulatedTaxel:
    return bench.node.taxels[0]


def samples(bench: Bench, channel: str = "t01.capacitance") -> list[Samples]:
    return samples_of(bench, channel)


def assert_truth_is_inside(found: list[Samples]) -> None:
    assert found
    for each in found:
        assert each.hold_truth(), each.ticks
        assert each.tube.time[0] <= each.time <= each.tube.time[1]


def width(found: list[Samples]) -> float:
    return float(np.median(np.concatenate([block.tube.values.wid for block in found])))


def test_gain_narrows_what_is_measured_and_still_holds_the_truth(tmp_path: Path) -> None:
    bench = Bench(tmp_path, "fingertip")
    third = bench.node.taxels[1]  # 20 to 150 pF: at most 530 µA of the converter's 1 mA
    bench.run_to(1.0)
    before = samples(bench, "t02.current")
    third.amplify(1.7)
    bench.run_to(2.0)
    after = samples(bench, "t02.current")[len(before) :]
    assert_truth_is_inside([*before, *after])
    assert width(after) < 0.75 * width(before)
    bench.close()


def test_too_much_gain_saturates_and_is_reported(bench: Bench) -> None:
    first(bench).amplify(50.0)
    bench.run_to(2.0)
    found = samples(bench)
    assert_truth_is_inside(found)
    assert any(np.isneginf(block.tube.values.inf).any() for block in found)


def test_rate_changes_the_period_without_a_hole(bench: Bench) -> None:
    bench.run_to(1.0)
    before = len(samples(bench))
    first(bench).sample_every(SECOND // 100)
    bench.run_to(3.0)
    found = samples(bench)
    assert {block.tube.dt for block in found[:before]} == {SECOND // 1000}
    assert {block.tube.dt for block in found[before:]} == {SECOND // 100}
    ends = [block.ticks + len(block.tube) * block.tube.dt for block in found]
    assert ends[:-1] == [block.ticks for block in found[1:]]
    assert_truth_is_inside(found)
    assert first(bench).control_unit.schedule.dt == SECOND // 100


def test_peaks_only_sends_the_same_peaks_and_a_small_part_of_the_bytes(tmp_path: Path) -> None:
    said = []
    for name in ("all", "peaks"):
        bench = Bench(tmp_path / name, "palm")
        if name == "peaks":
            first(bench).control_unit.mode = PEAKS
        bench.run_to(10.0)
        found = [(peak.time, peak.height, peak.verdict) for peak in peaks_of(bench)]
        said.append((found, sum(map(len, bench.bodies())), samples(bench)))
        bench.close()
    (found, size, _), (only, small, none) = said
    assert only == found
    assert len(found) > 15
    assert none == []
    assert small < size / 8


def test_adaptive_is_silent_at_rest_but_for_a_heartbeat(tmp_path: Path) -> None:
    bench = Bench(tmp_path, "palm")
    taxel = first(bench)
    unit = next(unit for unit in taxel.control_unit.units if unit.name == "t01.area")
    unit.restart(taxel.control_unit.schedule, 1.0, 0.0)  # a threshold that nothing reaches
    taxel.control_unit.mode = ADAPTIVE
    taxel.control_unit.calibrate()
    bench.run_to(20.0)
    assert len(samples(bench, "t01.area")) == 10  # of 400: one in 40
    # A touch each 1.25 s leaves the rest of the others again and again.
    assert len(samples(bench)) > 100
    bench.close()


def test_smoothing_changes_peaks_and_never_the_samples(tmp_path: Path) -> None:
    said = []
    for name, weight in (("raw", 0.0), ("smooth", 0.9)):
        bench = Bench(tmp_path / name, "palm")
        first(bench).control_unit.smooth(weight)
        bench.run_to(10.0)
        said.append((samples(bench), peaks_of(bench, "t01.energy")))
        bench.close()
    (raw, rough), (smooth, calm) = said
    for a, b in zip(raw, smooth, strict=True):
        assert np.array_equal(a.tube.values.inf, b.tube.values.inf)
        assert np.array_equal(a.tube.values.sup, b.tube.values.sup)
    assert len(calm) < len(rough)
    assert sum(peak.count[0] for peak in calm) == 8


def test_coverage_of_a_smoothed_peak_counts_all_that_smoothing_remembers(bench: Bench) -> None:
    """Of the touched area with Gaussian noise: a smoothed sample holds if all before it do."""
    first(bench).control_unit.smooth(0.9)
    bench.run_to(10.0)
    tube = samples(bench, "t01.area")[0].tube
    found = peaks_of(bench, "t01.area")
    assert len(found) > 3
    for peak in found:
        before = (peak.time[0] - tube.time[1]) // tube.dt
        assert peak.coverage <= union_coverage(tube.coverage, n=before) < 1.0
    assert found[-1].coverage < found[0].coverage


def test_threshold_above_the_swing_finds_no_peak(bench: Bench) -> None:
    unit = first(bench).control_unit
    unit.set_threshold(1, 1e-9)
    bench.run_to(5.0)
    assert peaks_of(bench, "t01.capacitance") == []
    unit.set_threshold(1, 0.4e-12)
    bench.run_to(10.0)
    assert len(peaks_of(bench, "t01.capacitance")) >= 3


def test_reset_goes_back_to_the_design(tmp_path: Path) -> None:
    bench = Bench(tmp_path, "palm")
    taxel = first(bench)
    taxel.amplify(2.0)
    taxel.sample_every(SECOND // 100)
    taxel.control_unit.mode = PEAKS
    bench.run_to(2.0)
    taxel.reset()
    bench.run_to(4.0)
    found = samples(bench)
    assert {block.tube.dt for block in found} == {SECOND // 1000}
    assert [each.ticks for each in found] == [(40 + n) * SECOND // 20 for n in range(40)]
    assert_truth_is_inside(found)
    bench.close()


# A rest of 10 ± 0.5 with measurements of ± 0.1; a touch is farther than 1 from it.
FRAME = 20


def frame(level: float) -> tuple[list[float], list[float]]:
    return [level - 0.1] * FRAME, [level + 0.1] * FRAME


def test_sustained_contact_is_never_learned() -> None:
    baseline = Baseline()
    assert baseline.calibrate(*frame(10.0), FRAME)
    for _ in range(5_000):
        assert not baseline.track(*frame(11.2), FRAME, 1.0)
    assert baseline.track(*frame(10.0), FRAME, 1.0)


def test_slow_drift_is_followed_as_far_as_it_goes() -> None:
    baseline = Baseline()
    baseline.calibrate(*frame(10.0), FRAME)
    for step in range(4_000):
        assert baseline.track(*frame(10.0 + step * 1e-3), FRAME, 1.0), step
    assert not baseline.track(*frame(10.0), FRAME, 1.0)


def test_unbounded_samples_calibrate_nothing() -> None:
    baseline = Baseline()
    assert not baseline.calibrate([0.0, -np.inf], [1.0, 1.0], 2)
    assert not baseline.track([0.0], [1.0], 1, 10.0)


BOUNDS = st.tuples(st.floats(-1e6, 1e6), st.floats(0.0, 10.0))


@given(st.lists(st.one_of(BOUNDS, st.none()), max_size=60), st.floats(0.0, 0.99), st.data())
def test_smoothed_bounds_enclose_every_smoothed_signal(
    samples: list[tuple[float, float] | None], weight: float, data: st.DataObject
) -> None:
    lows = [-np.inf if s is None else s[0] for s in samples]
    highs = [s[0] + s[1] if s is not None else np.inf for s in samples]
    truth = [0.0 if s is None else s[0] + data.draw(st.floats(0.0, 1.0)) * s[1] for s in samples]
    inside = [max(min(t, h), low) for t, low, h in zip(truth, lows, highs, strict=True)]
    smoothing = Smoothing(weight)
    smoothing.smooth(lows, highs, len(lows))
    past: Fraction | None = None
    for k, value in enumerate(inside):
        if samples[k] is None:
            past = None
            continue
        present = Fraction(value)
        share = Fraction(weight)
        past = present if past is None else share * past + (1 - share) * present
        assert lows[k] <= past <= highs[k]
