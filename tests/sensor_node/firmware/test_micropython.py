"""The firmware runs under MicroPython as it stands, and says the same, byte for byte."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest

import sensor_node
from eskin.messages import Block, Gap, Peak, Status, decode_message
from sensor_node.scenario.file import scenario_text
from tests.sensor_node.designs import SECOND, Bench, table
from tests.sensor_node.firmware.jobs import Recorder

ROOM = Path(sensor_node.__file__).parent
PORT = Path(__file__).parents[2] / "micropython"


def under_micropython(job: dict[str, Any], folder: Path) -> list[str]:
    node = shutil.which("node") or str(Path(".venv/bin/node").absolute())
    assert (PORT / "node_modules").is_dir(), "MicroPython is missing: run make test"
    given, answer = folder / "job.json", folder / "answer.json"
    given.write_text(json.dumps(job))
    subprocess.run([node, PORT / "run.mjs", ROOM, given, answer], check=True, timeout=120)
    said: list[str] = json.loads(answer.read_text())
    return said


@pytest.mark.parametrize(
    ("profile", "encoding"), [("fingertip", "f64"), ("palm", "f32"), ("forearm", "q16")]
)
def test_same_bytes_as_in_the_emulated_node(
    profile: str, encoding: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    recorder = Recorder(monkeypatch)
    bench = Bench(tmp_path, profile, drift=50_000, sampling={"encoding": encoding})
    bench.node.record_status()
    bench.run_to(2.0)
    bench.ticks = 4 * SECOND  # an overrun: what was undecided is told, and a gap
    bench.node.advance(bench.ticks)
    taxel = bench.node.taxels[0]
    taxel.control_unit.calibrate()
    taxel.control_unit.smooth(0.75)
    taxel.control_unit.set_threshold(0, 1.1e-12)
    taxel.amplify(1.1)
    taxel.sample_every(SECOND // 500)
    bench.run_to(6.0)
    bench.node.finish()
    said = [body.hex() for body in bench.bodies()]
    bench.close()
    assert under_micropython(recorder.job, tmp_path) == said
    kinds = {type(decode_message(bytes.fromhex(body))) for body in said}
    assert kinds == {Block, Gap, Peak, Status}


def test_same_bytes_of_every_taxel_that_lives_a_scenario(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    recorder = Recorder(monkeypatch)
    # Breath freezes, too: below 0 °C a thermometer has a formula of its own.
    scene = scenario_text("hand.toml").replace("[0.0, 22.0]", "[0.0, -30.0]")
    (tmp_path / "scene.toml").write_text(scene)
    kinds = ("thermometer", "hygrometer", "bioelectric", "coil", "pad")
    changes: dict[str, Any] = {"scenario": str(tmp_path / "scene.toml"), "sampling_Hz": 50.0}
    taxels = [table(kind, **changes) for kind in kinds]
    taxels[0]["adc_min"] = 0.4
    taxels[-1] |= {"place": "t05", "temperature_min_Cel": -40.0}
    bench = Bench(tmp_path, "hand", taxel=taxels, sampling={"encoding": "f64"})
    bench.run_to(10.0)
    bench.node.finish()
    said = [body.hex() for body in bench.bodies()]
    bench.close()
    assert under_micropython(recorder.job, tmp_path) == said
    blocks = [decode_message(bytes.fromhex(body)) for body in said]
    channels = {block.channel for block in blocks if isinstance(block, Block)}
    assert len(channels) == 1 + 1 + 1 + 5 + 5
