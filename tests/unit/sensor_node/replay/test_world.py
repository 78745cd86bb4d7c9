"""A recording in the place of physics: the same path, and nothing made up where it is silent."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import pytest
from eskin_sensor_node.kinds.generator import ColumnGenerator
from eskin_sensor_node.kinds.recorded import RecordedWorld
from eskin_sensor_node.kinds.registry import Taxel, build_frontend, build_world
from eskin_sensor_node.machine.inversion import Inversion
from pydantic import TypeAdapter

from eskin.errors import RecordingError
from tests.unit.sensor_node.designs import START, Bench, table
from tests.unit.sensor_node.messages import (
    Samples,
    StatedPeak,
    assert_truth_is_inside,
    gaps_of,
    peaks_of,
    samples_of,
)

if TYPE_CHECKING:
    from pathlib import Path

    from eskin_sensor_node.kinds.settings import TaxelSection

    from eskin.interval import Interval
    from eskin.wire.frames import Gap

TIMES = np.arange(100) / 100.0
WAVE = 50.0 + 40.0 * np.sin(2.0 * np.pi * TIMES)  # pF


def design(path: Path, kind: str = "capacitance", **changes: Any) -> dict[str, Any]:
    source = table("capacitive" if kind == "capacitance" else "inductive")
    dropped = ("capacitance_min_F", "capacitance_max_F", "capacitance_tolerance", "stimulus_Hz")
    swing = ("distance_mid_m", "distance_amplitude_m", "stimulus_Hz")
    for key in dropped if kind == "capacitance" else swing:
        del source[key]
    own = {"kind": f"recorded_{kind}", "recording": str(path), "channel": "a", "sampling_Hz": 100.0}
    return source | own | changes


def sheet(path: Path, kind: str = "capacitance", **changes: Any) -> TaxelSection:
    made: TaxelSection = TypeAdapter(Taxel).validate_python(design(path, kind, **changes))
    return made


def recording(folder: Path, rows: list[str], head: str = "time,channel,value\n") -> Path:
    path = folder / "rec.csv"
    path.write_text(head + "".join(rows))
    return path


def wave(folder: Path) -> Path:
    return recording(
        folder, [f"{t!r},a,{v!r}\n" for t, v in zip(TIMES.tolist(), WAVE.tolist(), strict=True)]
    )


def test_recorded_values_are_the_truth_and_the_intervals_hold_them(tmp_path: Path) -> None:
    taxel = sheet(wave(tmp_path), scale=1e-12)
    random = ColumnGenerator(1, 0)
    world, frontend = build_world(taxel, random), build_frontend(taxel, random)
    random.begin(1, np.arange(len(TIMES)))
    signals = world.signals(TIMES, random)
    assert signals.truth["capacitance"][0] == pytest.approx(WAVE * 1e-12)
    measured = Inversion(taxel).measure(frontend.digitise(signals.sensed, random).codes)
    assert np.all(measured["capacitance"].contains(signals.truth["capacitance"]))
    assert measured["capacitance"].wid.max() < 4e-12


def test_inductance_travels_the_chain_of_a_coil(tmp_path: Path) -> None:
    path = recording(tmp_path, [f"{t},a,{6e-3 + t * 1e-4}\n" for t in range(10)])
    taxel = sheet(path, "inductance")
    random = ColumnGenerator(1, 0)
    world, frontend = build_world(taxel, random), build_frontend(taxel, random)
    random.begin(1, np.arange(10))
    signals = world.signals(np.arange(10.0), random)
    measured = Inversion(taxel).measure(frontend.digitise(signals.sensed, random).codes)
    assert signals.truth["inductance"][0] == pytest.approx(6e-3 + np.arange(10) * 1e-4)
    assert np.all(measured["inductance"].contains(signals.truth["inductance"]))


def test_recorded_intervals_give_a_world_from_inside_of_them(tmp_path: Path) -> None:
    rows = [f"{k},a,{k + 10},{k + 11}\n" for k in range(200)]
    path = recording(tmp_path, rows, "time,channel,lo,hi\n")
    times = np.arange(200.0)
    values = []
    for seed in (1, 1, 2):
        random = ColumnGenerator(seed, 0)
        found = build_world(sheet(path), random).signals(times, random)
        values.append(found.truth["capacitance"][0] - times)
    assert np.array_equal(values[0], values[1])
    assert not np.array_equal(values[0], values[2])
    assert 10.0 <= values[0].min() < 10.1
    assert 10.9 < values[0].max() <= 11.0


def test_nothing_is_made_up_in_gaps_after_the_end_and_where_it_is_unbounded(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    rows = [f"{k},a,20e-12,20e-12\n" for k in (0, 1, 2, 3, 7, 8)] + ["9,a,20e-12,inf\n"]
    path = recording(tmp_path, rows, "time,channel,lo,hi\n")
    taxel = sheet(path)
    with caplog.at_level(logging.WARNING):
        world = build_world(taxel, ColumnGenerator(1, 0))
    assert "line 6: gap of 4 s in a before this" in caplog.text
    assert isinstance(world, RecordedWorld)
    times = np.arange(12.0)
    assert np.flatnonzero(world.missing(times)).tolist() == [4, 5, 6, 10, 11]


def test_sample_between_two_recorded_ones_takes_the_nearest(tmp_path: Path) -> None:
    path = recording(tmp_path, ["0,a,1\n", "1,a,2\n", "2,a,3\n"])
    world = build_world(sheet(path), ColumnGenerator(1, 0))
    found = world.signals(np.array([0.0, 0.4, 0.6, 1.4, 2.0, 2.4]), ColumnGenerator(1, 0))
    assert found.truth["capacitance"][0].tolist() == [1.0, 1.0, 2.0, 2.0, 3.0, 3.0]


def test_channel_that_is_not_in_the_recording_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match=r"rec\.csv: channel: 'b' is not in it; it has a"):
        build_world(sheet(wave(tmp_path), channel="b"), ColumnGenerator(1, 0))


def test_node_replays_a_recording_and_every_block_holds_its_truth(tmp_path: Path) -> None:
    path = wave(tmp_path)
    bench = Bench(tmp_path, taxel=[design(path, scale=1e-12)], sampling={"stretch_ms": 500.0})
    bench.run_to(2.0)
    found = samples_of(bench)
    assert len(found) == 4  # of the second that was recorded
    assert_truth_is_inside(found)
    first = next(each for each in found if each.channel == "t01.capacitance")
    assert first.truth == pytest.approx(WAVE[:50] * 1e-12)
    bench.close()


class Replay(NamedTuple):
    """What a node says."""

    samples: list[Samples]
    peaks: list[StatedPeak]
    gaps: list[Gap]


def replayed(folder: Path, path: Path, until: float, **changes: Any) -> Replay:
    """What a node says, after the truth was found inside of all its samples."""
    bench = Bench(folder, taxel=[design(path, **changes)], sampling={"stretch_ms": 500.0})
    bench.run_to(until)
    found = Replay(samples_of(bench), peaks_of(bench), gaps_of(bench))
    assert_truth_is_inside(found.samples)
    bench.close()
    return found


def sampled(found: Replay) -> dict[int, Interval]:
    """Number of the sample to its interval of capacitance."""
    return {
        each.ticks // 10_000_000 + k: each.tube.values[k]
        for each in found.samples
        if each.channel == "t01.capacitance"
        for k in range(len(each.tube))
    }


def test_gap_of_a_recording_travels_as_a_gap_and_as_no_sample(tmp_path: Path) -> None:
    there = [k for k in range(150) if not 20 <= k < 120]
    path = recording(tmp_path, [f"{k / 100},a,{30 + k / 10}\n" for k in there])
    replay = replayed(tmp_path, path, 2.0, scale=1e-12)
    found, gaps = sampled(replay), replay.gaps
    assert sorted(found) == there
    assert all(bool(each.is_common_interval) for each in found.values())
    assert {gap.reason for gap in gaps} == {"nothing recorded"}
    assert sum(gap.samples for gap in gaps) == 2 * (200 - len(there))
    before, after = gaps[0].time[0] - START, gaps[-1].time[1] - START
    assert before == pytest.approx(0.2e9, abs=5e6)
    assert after == pytest.approx(2.0e9, abs=5e6)
    assert all(gap.time[0] < gap.time[1] for gap in gaps)


def test_peak_is_not_joined_across_a_gap_of_the_recording(tmp_path: Path) -> None:
    height = [10.0] * 20 + [80.0] * 20 + [10.0] * 20
    whole = [f"{k / 100},a,{c}\n" for k, c in enumerate(height)]
    found = []
    for name, rows in (("whole", whole), ("broken", whole[:25] + whole[35:])):
        folder = tmp_path / name
        folder.mkdir()
        changes = {"scale": 1e-12, "capacitance_prominence_F": 20e-12}
        peaks = replayed(folder, recording(folder, rows), 1.0, **changes).peaks
        found.append([peak.count for peak in peaks if peak.channel == "t01.capacitance"])
    assert found == [[(1, 1)], []]


@pytest.mark.parametrize("kind", ["capacitance", "inductance"])
def test_recorded_intervals_travel_unshrunk(kind: str, tmp_path: Path) -> None:
    ends = {"capacitance": (2e-11, 7e-11), "inductance": (5.3e-3, 7e-3)}[kind]
    random = np.random.default_rng(5)
    pairs = np.sort(random.uniform(*ends, (100, 2)), axis=1)
    rows = [f"{k / 100},a,{lo!r},{hi!r}\n" for k, (lo, hi) in enumerate(pairs.tolist())]
    path = recording(tmp_path, rows, "time,channel,lo,hi\n")
    found = replayed(tmp_path, path, 1.0, kind=kind).samples
    tubes = [each.tube for each in found if each.channel == f"t01.{kind}"]
    lows = np.concatenate([tube.values.inf for tube in tubes])
    highs = np.concatenate([tube.values.sup for tube in tubes])
    assert np.all(lows <= pairs[:, 0])
    assert np.all(highs >= pairs[:, 1])
    width = ends[1] - ends[0]
    assert np.median(highs - lows - np.diff(pairs)[:, 0]) < 0.05 * width


def test_unbounded_side_of_a_recording_stays_unbounded_alone(tmp_path: Path) -> None:
    rows = [f"{k / 100},a,{lo},{hi}\n" for k, (lo, hi) in enumerate([("2e-11", "inf")] * 50)]
    path = recording(tmp_path, rows, "time,channel,lo,hi\n")
    found = sampled(replayed(tmp_path, path, 0.5))
    assert len(found) == 50
    for each in found.values():
        assert 1.5e-11 < float(each.inf) <= 2e-11
        assert float(each.sup) == np.inf
