"""The firmware runs under MicroPython as it stands, and says the same, byte for byte."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest

import sensor_node
from eskin.messages import Block, Gap, Peak, Shedding, Status, decode_message
from tests.sensor_node.designs import SECOND, Bench
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


def test_same_energy_as_in_the_emulated_node(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    recorder = Recorder(monkeypatch)
    energy = {"on": True, "start_voltage": 3.0, "horizon_s": 1.0, "coil_inductance": 0.01}
    bench = Bench(tmp_path, "palm", energy=energy)
    for second in range(1, 5):
        bench.run_to(float(second))
        bench.node.record_status()
    said = [body.hex() for body in bench.bodies()]
    bench.close()
    assert under_micropython(recorder.job, tmp_path) == said
    messages = [decode_message(bytes.fromhex(body)) for body in said]
    told = [message.energy for message in messages if isinstance(message, Status)]
    assert len(told) == 4
    assert {each.shedding for each in told if each is not None} == {Shedding.ADAPTIVE}
