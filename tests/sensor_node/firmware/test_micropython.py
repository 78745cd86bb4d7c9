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


def test_adaptive_control_sets_the_same(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    recorder = Recorder(monkeypatch)
    changes = {"gain_least": 0.25, "gain_tolerance": 1e-3, "trimmer_steps": 300}
    moved = table("touch", adaptive=True, adc_min_A=1.2e-4, actuator_steps=4, **changes)
    bench = Bench(tmp_path, "palm", taxel=(moved,), sampling={"block_samples": 50})
    bench.run_to(3.0)
    said = [body.hex() for body in bench.bodies()]
    settings = bench.node.taxels[0].control_unit.adaptation
    bench.close()
    assert (settings.gain, settings.trim) != (1.0, 0)
    assert under_micropython(recorder.job, tmp_path) == said


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
    taxel.adapt(on=True)
    taxel.sample_every(SECOND // 500)
    bench.run_to(6.0)
    bench.node.finish()
    said = [body.hex() for body in bench.bodies()]
    bench.close()
    assert under_micropython(recorder.job, tmp_path) == said
    kinds = {type(decode_message(bytes.fromhex(body))) for body in said}
    assert kinds == {Block, Gap, Peak, Status}
