"""The computed need of RAM against MicroPython's heap, which is laid out as a microcontroller's."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path
from typing import Any

import eskin_sensor_node
import pytest
from eskin_sensor_node.machine.budget import PROGRAM, ram_budget, require_ram, taxel_objects
from eskin_sensor_node.machine.node_layout import plan_layout
from eskin_sensor_node.node.factory import build_node, build_outbox
from eskin_sensor_node.node.ground_truth import GroundTruth

from eskin.errors import SettingsError
from tests.unit.sensor_node.designs import Bench, settings
from tests.unit.sensor_node.firmware.jobs import Recorder
from tests.unit.sensor_node.flashes import open_flash

ROOM = Path(eskin_sensor_node.__file__).parent
PORT = Path(__file__).parents[3] / "contract" / "micropython"
PROFILES = ["fingertip", "palm", "forearm", "hand"]


def heap(job: dict[str, Any], folder: Path) -> dict[str, Any]:
    node = shutil.which("node") or str(Path(".venv/bin/node").absolute())
    assert (PORT / "node_modules").is_dir(), "MicroPython is missing: run make test"
    given, answer = folder / "job.json", folder / "answer.json"
    given.write_text(json.dumps(job))
    subprocess.run([node, PORT / "memory.mjs", ROOM, given, answer], check=True)
    found: dict[str, Any] = json.loads(answer.read_text())
    return found


@pytest.mark.parametrize(
    ("profile", "stretch", "seconds"),
    [
        ("fingertip", 250.0, 1.0),
        pytest.param("forearm", 50.0, 0.3, marks=pytest.mark.nightly),
        pytest.param("hand", 50.0, 0.2, marks=pytest.mark.nightly),
    ],
)
def test_computed_ram_holds_what_micropython_uses_and_not_much_more(
    profile: str,
    stretch: float,
    seconds: float,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    recorder = Recorder(monkeypatch)
    bench = Bench(tmp_path, profile, sampling={"stretch_ms": stretch})
    bench.run_to(seconds)
    bench.close()
    budget, found = ram_budget(bench.settings), heap(recorder.job, tmp_path)
    assert 0.3 * PROGRAM < found["program"] <= PROGRAM
    measured = sum(found["taxels"]) + found["growth"]
    assert measured <= budget.bounds + budget.objects <= 3 * measured
    assert found["waiting"] <= budget.waiting <= 3 * found["waiting"]
    assert 0 < found["records"] <= budget.messages
    for taxel, unit, used in zip(
        bench.settings.taxel, bench.node.taxels, found["taxels"], strict=True
    ):
        bounds = 16 * unit.control_unit.schedule.capacity * len(taxel.units)
        assert bounds < used <= bounds + taxel_objects(taxel), taxel.id


@pytest.mark.parametrize("profile", PROFILES)
def test_packaged_profiles_fit_into_the_default_machine(profile: str, tmp_path: Path) -> None:
    require_ram(settings(tmp_path, profile))


def test_page_of_the_node_shows_the_budget_of_each_profile(tmp_path: Path) -> None:
    budgets = [ram_budget(settings(tmp_path, profile)) for profile in PROFILES]
    page = (Path(__file__).parents[4] / "docs" / "node.md").read_text()
    for name in budgets[0].parts():
        row = " | ".join(str(budget.parts()[name]) for budget in budgets)
        assert f"| {row} |" in page, name
    assert f"| **all** | {' | '.join(str(budget.total) for budget in budgets)} |" in page


def test_budget_follows_the_layout(tmp_path: Path) -> None:
    budget = ram_budget(settings(tmp_path, "fingertip"))
    assert budget.bounds == 3 * 2 * 2 * 8 * 50
    assert budget.codes == 3 * 2 * (2 + 1) * 50
    assert budget.total == sum(budget.parts().values())


def test_node_that_does_not_fit_is_refused_with_numbers_and_remedy(
    tmp_path: Path,
) -> None:
    small = settings(tmp_path, "hand", machine={"ram_bytes": 262_144})
    flash, truth = open_flash(small.flash.path), GroundTruth(small.truth.path, limit=10**6)
    described = plan_layout(small).described
    outbox = build_outbox(flash, capacity=10**6, broker=small.broker, described=described)
    need = ram_budget(small).total
    assert need > 262_144
    with pytest.raises(
        SettingsError, match=r"machine\.ram_bytes: 262144 bytes do not hold"
    ) as error:
        build_node(small, outbox=outbox, truth=truth)
    assert f"needs {need} (program" in str(error.value)
    assert "shorter sampling.stretch_ms than 50" in str(error.value)
    require_ram(settings(tmp_path, "hand", machine={"ram_bytes": need}))
    flash.close()
    truth.close()
