"""A recording in the place of physics: the same path, and nothing made up where it is silent."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from pydantic import TypeAdapter

from eskin.errors import RecordingError
from eskin.messages import Block, decode_message
from sensor_node.frontend import build_frontend
from sensor_node.machine.inversion import Inversion
from sensor_node.physics import build_world
from sensor_node.physics.recorded import RecordedWorld
from sensor_node.taxels import Taxel
from sensor_node.truth import Truth
from tests.sensor_node.designs import Bench, table

if TYPE_CHECKING:
    from pathlib import Path

    from sensor_node.taxels import AnyTaxel

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


def sheet(path: Path, kind: str = "capacitance", **changes: Any) -> AnyTaxel:
    made: AnyTaxel = TypeAdapter(Taxel).validate_python(design(path, kind, **changes))
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
    random = np.random.default_rng(1)
    world, frontend = build_world(taxel, random), build_frontend(taxel, random)
    signals = world.signals(TIMES, random)
    assert signals.truth["capacitance"] == pytest.approx(WAVE * 1e-12)
    measured = Inversion(taxel).measure(frontend.digitise(signals.sensed, random).codes)
    assert np.all(measured["capacitance"].contains(signals.truth["capacitance"]))
    assert measured["capacitance"].wid.max() < 4e-12


def test_inductance_travels_the_chain_of_a_coil(tmp_path: Path) -> None:
    path = recording(tmp_path, [f"{t},a,{6e-3 + t * 1e-4}\n" for t in range(10)])
    taxel = sheet(path, "inductance")
    random = np.random.default_rng(1)
    world, frontend = build_world(taxel, random), build_frontend(taxel, random)
    signals = world.signals(np.arange(10.0), random)
    measured = Inversion(taxel).measure(frontend.digitise(signals.sensed, random).codes)
    assert signals.truth["inductance"] == pytest.approx(6e-3 + np.arange(10) * 1e-4)
    assert np.all(measured["inductance"].contains(signals.truth["inductance"]))


def test_recorded_intervals_give_a_world_from_inside_of_them(tmp_path: Path) -> None:
    rows = [f"{k},a,{k + 10},{k + 11}\n" for k in range(200)]
    path = recording(tmp_path, rows, "time,channel,lo,hi\n")
    times = np.arange(200.0)
    values = []
    for seed in (1, 1, 2):
        random = np.random.default_rng(seed)
        found = build_world(sheet(path), random).signals(times, random)
        values.append(found.truth["capacitance"] - times)
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
        world = build_world(taxel, np.random.default_rng(1))
    assert "line 6: gap of 4 s in a before this" in caplog.text
    assert isinstance(world, RecordedWorld)
    times = np.arange(12.0)
    assert np.flatnonzero(world.missing(times)).tolist() == [4, 5, 6, 9, 10, 11]
    random = np.random.default_rng(2)
    codes = build_frontend(taxel, random).digitise(world.signals(times, random).sensed, random)
    measured = Inversion(taxel).measure(codes.codes)["capacitance"]
    assert np.array_equal(~measured.is_common_interval, world.missing(times))


def test_sample_between_two_recorded_ones_takes_the_nearest(tmp_path: Path) -> None:
    path = recording(tmp_path, ["0,a,1\n", "1,a,2\n", "2,a,3\n"])
    world = build_world(sheet(path), np.random.default_rng(1))
    found = world.signals(np.array([0.0, 0.4, 0.6, 1.4, 2.0, 2.4]), np.random.default_rng(1))
    assert found.truth["capacitance"].tolist() == [1.0, 1.0, 2.0, 2.0, 3.0, 3.0]


def test_channel_that_is_not_in_the_recording_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match=r"rec\.csv: channel: 'b' is not in it; it has a"):
        build_world(sheet(wave(tmp_path), channel="b"), np.random.default_rng(1))


def test_node_replays_a_recording_and_every_block_holds_its_truth(tmp_path: Path) -> None:
    path = wave(tmp_path)
    bench = Bench(tmp_path, taxel=[design(path, scale=1e-12)], sampling={"block_samples": 50})
    bench.run_to(2.0)
    messages = [decode_message(body) for body in bench.bodies()]
    blocks = [message for message in messages if isinstance(message, Block)]
    truth = Truth.read(bench.settings.truth.path, [block.position for block in blocks])
    assert len(blocks) == 8
    for block in blocks:
        assert np.all(block.tube.values.contains(truth[block.position].values)), block.channel
    first = next(block for block in blocks if block.channel == "t01.capacitance")
    assert truth[first.position].values == pytest.approx(WAVE[:50] * 1e-12)
    bench.close()
