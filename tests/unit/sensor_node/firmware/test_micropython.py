"""The firmware runs under MicroPython as it stands, and says the same, byte for byte."""

from __future__ import annotations

import json
import math
import random
import shutil
import subprocess
import time
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Any

import eskin_sensor_node
import numpy as np
import pytest
from eskin_sensor_node.firmware.charge import write_charge
from eskin_sensor_node.firmware.gap_reasons import FAILED, FULL, TEXTS
from eskin_sensor_node.firmware.message_writer import FRAME, STATEMENTS
from eskin_sensor_node.node.commands import CommandReceiver, NodeControls
from eskin_sensor_node.world.scenario.file import scenario_text

from eskin.identity import IdentityKind
from eskin.interval import Interval
from eskin.monitor import Atom, parse
from eskin.monitor.program import instructions
from eskin.wire.envelope import sign
from eskin.wire.frames import Frame, Sampling, Statements, encode_samples
from eskin.wire.messages import Command, CommandName, Kind, Outcome, Result, Shedding, Status
from eskin.wire.topics import Stream, node_topic
from tests.contract.micropython.delivery import deliver
from tests.contract.micropython.examination import examine
from tests.contract.micropython.monitoring import decide
from tests.unit.sensor_node.designs import SECOND, Bench, table
from tests.unit.sensor_node.firmware.jobs import Recorder
from tests.unit.sensor_node.messages import decode, frames_of

if TYPE_CHECKING:
    from eskin.wire.messages.command import Arguments
    from tests.support.identities import Identities

ROOM = Path(eskin_sensor_node.__file__).parent
PORT = Path(__file__).parents[3] / "contract" / "micropython"


def under_micropython(job: dict[str, Any], folder: Path) -> list[Any]:
    node = shutil.which("node") or str(Path(".venv/bin/node").absolute())
    assert (PORT / "node_modules").is_dir(), "MicroPython is missing: run make test"
    given, answer = folder / "job.json", folder / "answer.json"
    given.write_text(json.dumps(job))
    subprocess.run([node, PORT / "run.mjs", ROOM, given, answer], check=True)
    said: list[Any] = json.loads(answer.read_text())
    return said


def test_adaptive_control_sets_the_same(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    recorder = Recorder(monkeypatch)
    changes = {"gain_least": 0.25, "gain_tolerance": 1e-3, "trimmer_steps": 300}
    moved = table("touch", adaptive=True, adc_min_A=1.2e-4, actuator_steps=4, **changes)
    pad = table("pad", adaptive=True, adc_min_A=8.5e-4, actuator_steps=4, gain_most=1.0)
    pad = {key: pad[key] for key in pad if key not in ("thermometer", "hygrometer")}
    still = table("touch", id="t02", sampling_Hz=250.0, stimulus_Hz=1e-9, adaptive=True, **changes)
    taxels = moved, pad, still
    bench = Bench(tmp_path, "palm", taxel=taxels, sampling={"stretch_ms": 200.0})
    bench.run_to(2.0)
    # At once, and beyond what it is set to by now.
    world: Any = bench.node.taxels[2].group.sensing.world
    world._least = world._most = world._least / 4.0
    bench.run_to(3.0)
    plate = bench.node.taxels[1].control_unit.adaptation.plate
    # As if a self-test had found it: it states no cause any more, and the status says so.
    bench.node.taxels[1].control_unit.broken = True
    bench.node._self_test.faults = [("t00", 0, 2), ("t01", 1, 0)]
    bench.node.record_status()
    bench.run_to(4.0)
    said = [body.hex() for body in bench.bodies()]
    settings = bench.node.taxels[0].control_unit.adaptation
    bench.close()
    frames = [each for step in recorder.job["steps"] for each in step.get("codes", ())]
    assert {len(asked) for each in frames for _, _, asked in each["again"]} >= {0, 1}
    assert (settings.gain, settings.trim) != (1.0, 0)
    assert plate > 0
    assert under_micropython(recorder.job, tmp_path) == said


@pytest.mark.parametrize(
    "profile",
    [
        "fingertip",
        pytest.param("palm", marks=pytest.mark.nightly),
        pytest.param("forearm", marks=pytest.mark.nightly),
    ],
)
def test_same_bytes_as_in_the_emulated_node(
    profile: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    recorder = Recorder(monkeypatch)
    bench = Bench(tmp_path, profile, drift=50_000)
    bench.node.record_status()
    bench.run_to(2.0)
    bench.ticks = 4 * SECOND  # an overrun: what was undecided is stated, and a gap
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
    found = [decode(bytes.fromhex(body)) for body in said]
    assert {type(each) for each in found} == {Frame, Statements, Status}
    stated = [each for each in found if isinstance(each, Statements)]
    assert any(each.peaks for each in stated)
    assert any(each.gaps for each in stated)


def test_samples_of_a_patch_have_the_same_bytes(tmp_path: Path) -> None:
    draw = np.random.default_rng(5)
    given: list[list[Any]] = []
    expected: list[list[Any]] = []
    for number in range(60):
        rows, columns = int(draw.integers(1, 6)), int(draw.choice([1, 3, 14, 64]))
        strides = bytes(draw.integers(0, 3, columns).tolist()) if number % 3 == 0 else b""
        first_row = int(draw.choice([0, 5, 2**53 - 1]))
        size, width = 10.0 ** draw.choice([-320, -12, 0, 5, 290]), 10.0 ** draw.choice([-15, 0, 3])
        lo = size * draw.normal(size=(rows, columns))
        hi = lo + width * draw.random((rows, columns))
        lo[draw.random(lo.shape) < 0.1] = -np.inf
        hi[draw.random(hi.shape) < 0.1] = np.inf
        bounds = [side.astype("<f8").tobytes().hex() for side in (np.array(width), lo, hi)]
        given.append([rows, columns, str(first_row), list(strides), *bounds])
        sampling = Sampling(rows, columns, first_row, strides)
        exponent, offset, codes = encode_samples(Interval(lo, hi), sampling, float(width))
        expected.append([exponent, str(offset), codes.hex()])
    assert under_micropython({"matrices": given}, tmp_path) == expected


MONITORS = (
    "p > 0",
    "count(p > 0, q > 0) >= 2 or not q > 0",
    "count(p > 0, q > 0) < 2 implies once[3ms,20ms] p > 0",
    "historically[0,9ms](p > 0 since[0,20ms] q > 0)",
    "rise(p > 0) and once[1ms,40ms] fall(q > 0)",
)


def test_monitors_decide_the_same(tmp_path: Path) -> None:
    draw = np.random.default_rng(11)
    jobs = []
    for text in MONITORS:
        formula = parse(text)
        atoms = list(dict.fromkeys(node for node in formula.walk() if isinstance(node, Atom)))
        lines = [
            [op, taken, str(a), str(b), number]
            for op, taken, a, b, number in instructions(
                formula, {atom: k for k, atom in enumerate(atoms)}
            )
        ]
        steps = draw.integers(-1, 6, (300, len(atoms))).tolist()
        ranges = [[4, 9, 2, 9, 1_000_000] for _ in atoms]
        jobs.append([lines, ranges, str(40_000_000), 20_000, str(1_000_000), steps])
    comparisons = []
    for _ in range(200):
        bounds = np.sort(
            draw.normal(size=(4, 2)) * 10.0 ** draw.integers(-300, 300, (4, 1)), axis=1
        )
        bounds[3] = np.sort(np.abs(bounds[3])) * draw.choice((-1.0, 1.0))
        bounds[3].sort()
        bounds[:3][draw.random((3, 2)) < 0.1] = 0.0
        bounds[:2].sort(axis=1)
        bounds[2].sort()
        given = [np.float64(bound).astype("<f8").tobytes().hex() for bound in bounds.ravel()]
        comparisons.append([given, bool(draw.random() < 0.5)])
    job = {"monitors": jobs, "comparisons": comparisons}
    expected = json.loads(json.dumps(decide(job)))
    assert under_micropython(job, tmp_path) == expected
    verdicts = {verdict for each in expected[: len(MONITORS)] for verdict, _ in each}
    assert verdicts == {0, 1, 2}


def fate(seed: int) -> list[list[Any]]:
    """A script of what may happen to an outbox."""
    draw = random.Random(seed)  # noqa: S311 - it only has to be the same again
    script: list[list[Any]] = [["connect"]]
    for _ in range(400):
        boot, first = draw.randint(1, 3), draw.randint(0, 200)
        script += draw.choice(
            [
                [["say", ["frame", draw.randint(1, 250)], ["statements", 0]]],
                [["say", *[["frame", 250]] * draw.randint(1, 9)]],
                [["wear_out"], ["say", ["frame", 9], ["statements", 0]], ["repair"]],
                [["say", ["result", draw.randint(1, 30)]]],
                [["status_is_due"], ["say", ["status", 0]]],
                [["send", draw.randint(1, 12)], ["leave", boot, 0, 500]],
                [["acknowledge", [boot, first, first + draw.randint(0, 30)]]],
                [["wear_out"], ["acknowledge", [boot, first, first + 9]], ["repair"]],
                [["wait", draw.randint(1, 50)]],
                draw.choice([[["restart"]], [["connect"]], []]),
            ]
        )
    return script


def test_outbox_decides_and_writes_the_same(tmp_path: Path) -> None:
    job = {"limits": [6000, 8, 60, 100, "5a" * 32], "script": fate(5)}
    expected = json.loads(json.dumps(deliver(job)))
    assert under_micropython(job, tmp_path) == expected
    sent = [m for step in expected[:-1:2] if type(step) is list for m in step if type(m) is list]
    assert {kind for _, kind, _ in sent} == {FRAME, STATEMENTS, Kind.STATUS, Kind.RESULT}
    stated = [
        Statements.decode(bytes.fromhex(body)) for _, kind, body in sent if kind == STATEMENTS
    ]
    assert {gap.reason for each in stated for gap in each.gaps} == {TEXTS[FULL], TEXTS[FAILED]}
    assert any(each.peaks and each.verdicts for each in stated)
    assert max(Counter(tuple(position) for position, _, _ in sent).values()) > 2
    assert max(len(gap.lost) for each in stated for gap in each.gaps) > 1


def test_same_bytes_of_every_taxel_in_a_scenario(
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
    taxels += [taxels[-1] | {"id": f"n{place}", "place": place} for place in ("t06", "t09")]
    bench = Bench(tmp_path, "hand", taxel=taxels, sampling={"stretch_ms": 500.0})
    bench.run_to(10.0)
    bench.node.finish()
    said = [body.hex() for body in bench.bodies()]
    bench.close()
    assert under_micropython(recorder.job, tmp_path) == said
    patches = bench.node.layout.patches
    found = [each for frame in frames_of(map(bytes.fromhex, said)) for each in frame.patches]
    sampled = {(patches[each.patch].quantity, each.patch, each.columns) for each in found}
    assert sum(columns for _, _, columns in sampled) == 1 + 1 + 1 + 5 + 3 * 5


def test_same_answers_to_commands(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, identities: Identities
) -> None:
    recorder, now = Recorder(monkeypatch), time.time_ns()
    bench = Bench(tmp_path, "palm")
    own, server = identities.node, identities.make(IdentityKind.SERVER, "server.cloud")
    commander = CommandReceiver(
        bench.outbox,
        own=own,
        cloud="server.cloud",
        controls=NodeControls(bench.node),
        enclosure=lambda: (now + bench.ticks, now + bench.ticks + 1000),
    )
    commander.start()
    names = CommandName.SET, CommandName.CALIBRATE, CommandName.SET, CommandName.SET
    arguments: list[Arguments] = [{"gain": 0.1, "taxel": "t01"}, {}, {"rate": 1e6}, {"rate": 50.0}]
    for number, (name, given) in enumerate(zip(names, arguments, strict=True), 1):
        bench.run_to(number / 2)
        expires = now + (1 if number == 4 else SECOND * 60)
        command = Command(number, own.name, now, expires, name, given)
        topic = node_topic(own.name, Stream.COMMANDS)
        for _ in range(number):  # however often it comes
            commander.take(sign(command.encode(), own=server, topic=topic))
    commander.take(sign(b"\xa1\x01\x02", own=server, topic=topic))
    other = Command(9, "forearm", now, now + SECOND * 60, CommandName.RESET, {})
    commander.take(sign(other.encode(), own=server, topic=topic))
    commander.start()  # as after a restart: what flash has kept is sent again
    said = [body.hex() for body in bench.bodies()]
    bench.close()
    assert under_micropython(recorder.job, tmp_path) == said
    messages = [decode(bytes.fromhex(body)) for body in said]
    stated = [message.outcome for message in messages if isinstance(message, Result)]
    assert stated == [Outcome.DONE] * 3 + [Outcome.REFUSED] + [Outcome.EXPIRED] * 2
    assert sum("take" in step for step in recorder.job["steps"]) == 12


def test_self_test_finds_the_same_in_the_emulated_node(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("eskin_sensor_node.node.self_test.SELF_TEST_WINDOW", 4 * SECOND)
    recorder = Recorder(monkeypatch)
    path = tmp_path / "faulty.toml"
    path.write_text(scenario_text("hand.toml") + '[[fault]]\ntaxel="t05"\nkind="dead"\nat_s=2.0\n')
    places = ("t01", "t04", "t05", "t06", "t09")
    changes = {"scenario": str(path), "sampling_Hz": 25.0}
    taxels = [table("pad", id=place, place=place, **changes) for place in places]
    for each in taxels:
        del each["thermometer"], each["hygrometer"]
    bench = Bench(tmp_path, "hand", taxel=taxels, sampling={"stretch_ms": 1000.0})
    bench.run_to(12.0)
    said: list[Any] = [body.hex() for body in bench.bodies()]
    bench.close()
    found = [step["examine"] for step in recorder.job["steps"] if "examine" in step]
    assert len(found) >= 2
    assert len({str(each) for each in found}) >= 2
    assert under_micropython(recorder.job, tmp_path) == said + found


def test_self_test_finds_the_same_in_any_tubes(tmp_path: Path) -> None:
    draw = np.random.default_rng(9)
    middle = draw.normal(size=(9, 8, 20)) * draw.choice([0.0, 1e-12, 0.1, 3.0], size=(9, 8, 1))
    tubes = np.stack([middle - 0.05, middle + draw.uniform(0.0, 0.1, middle.shape)], axis=-1)
    # Some are open, whole windows or single samples.
    tubes[..., 1][draw.random((9, 8)) < 0.1] = math.inf
    tubes[..., 0][draw.random(middle.shape) < 0.01] = -math.inf
    around = [[int(k) for k in draw.choice(9, draw.integers(0, 5), replace=False)] for _ in tubes]
    given = [[[pair.astype("<f8").tobytes().hex() for pair in w] for w in taxel] for taxel in tubes]
    job = {"neighbours": around, "tubes": given}
    expected = json.loads(json.dumps(examine(job)))
    assert under_micropython(job, tmp_path) == expected
    verdicts = [tuple(each) for stated in expected for each in stated if type(each) is list]
    assert {dead for dead, _ in verdicts} == {stuck for _, stuck in verdicts} == {0, 1, 2}


def test_same_energy_as_in_the_emulated_node(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    recorder = Recorder(monkeypatch)
    energy = {"on": True, "start_voltage": 3.0, "horizon_s": 1.0, "coil_inductance": 0.01}
    bench = Bench(tmp_path, "palm", energy=energy)
    with bench.outbox.batch() as batch:
        batch.store_charge(write_charge(0.5, bench.clock.true_time(0) - 9000 * SECOND))
    assert bench.node.energy is not None
    bench.node.energy.boot()
    bench.node.record_status()
    for second in range(1, 4):
        bench.run_to(float(second))
        bench.node.record_status()
    bench.node.finish()
    said = [body.hex() for body in bench.bodies()] + [bench.flash.charge().hex()]
    bench.close()
    assert under_micropython(recorder.job, tmp_path) == said
    messages = [decode(bytes.fromhex(body)) for body in said[:-1]]
    stated = [message.energy for message in messages if isinstance(message, Status)]
    first, *rest = [each for each in stated if each is not None]
    assert 0.4 < first.stored[0] < 0.5 < first.stored[1] < 1.0
    stages = [each.shedding for each in rest]
    assert (stages[0], stages[-1]) == (Shedding.ADAPTIVE, Shedding.PEAKS)
