"""The page "Add a sensor kind" really adds one, in at most ten files."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import pytest

if TYPE_CHECKING:
    from collections.abc import Sequence

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "add-a-sensor-kind.md").read_text()
PACKAGE = Path("sensor_node/eskin_sensor_node")
MOST = 10
STEP = re.compile(r"^### \d+\. `(\S+)`$(.*?)(?=^##)", re.MULTILINE | re.DOTALL)
FENCE = re.compile(r"^```(python|diff)\n(.*?)^```$", re.MULTILINE | re.DOTALL)

EMULATE = """
import sys
from pathlib import Path

import eskin_sensor_node

from tests.unit.sensor_node import designs, messages
from tests.unit.sensor_node.fleet import shards

copy, folder = map(Path, sys.argv[1:])
assert Path(eskin_sensor_node.__file__).is_relative_to(copy)
table = {"kind": "strain_gauge", "id": "t01", "noise": {"kind": "uniform", "bound": 1e-6}}
fields = {"taxel": [table | {"strain_prominence": 1e-3}], "sampling": {"stretch_ms": 250.0}}

bench = designs.Bench(folder / "node", "custom", **fields)
bench.run_to(3.0)
found = messages.samples_of(bench)
assert len(found) == 12
messages.assert_truth_is_inside(found)

fleet = shards.Bench(folder / "fleet", **fields)
single = shards.Single(fleet, 1, folder / "single")
for each in (fleet, single):
    each.run_to(1.5)
single.node.finish()
fleet.finish()
assert fleet.said(1) == single.said() != []
"""


class Change(NamedTuple):
    """A file that the page makes or changes.

    Attributes:
        path: Of the file, from the root on.
        language: Of the page's block: ``python`` for a new file, ``diff`` for a changed one;
            empty where the file is generated.
        text: The block.
    """

    path: Path
    language: str
    text: str


def changes() -> list[Change]:
    """All that the page asks for."""
    found = []
    for name, body in STEP.findall(PAGE):
        path = Path(name) if name.startswith("docs/") else PACKAGE / name
        language, text = next(iter(FENCE.findall(body)), ("", ""))
        found.append(Change(path, language, text))
    return found


def run(command: Sequence[str | Path], copy: Path, given: str = "") -> None:
    """Run a command that finds the copied package before the installed one."""
    path = os.pathsep.join([str(copy / "sensor_node"), str(ROOT)])
    done = subprocess.run(
        command,
        cwd=copy,
        env=os.environ | {"PYTHONPATH": path},
        capture_output=True,
        text=True,
        check=False,
        input=given,
    )
    assert done.returncode == 0, done.stderr


@pytest.fixture(scope="module")
def copy(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The sources with the page's changes."""
    root = tmp_path_factory.mktemp("copy")
    shutil.copytree(ROOT / PACKAGE, root / PACKAGE, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copytree(ROOT / "docs", root / "docs")
    for path, language, text in changes():
        if language == "python":
            assert not (root / path).exists()
            (root / path).write_text(text)
        elif language == "diff":
            patch = f"--- a/{path}\n+++ b/{path}\n{text}"
            run(["git", "apply", "--recount", "--unidiff-zero", "-"], root, patch)
    return root


def test_a_kind_takes_at_most_ten_files() -> None:
    assert 0 < len({change.path for change in changes()}) <= MOST


@pytest.mark.nightly
def test_emulated_node_and_fleet_enclose_the_truth(copy: Path, tmp_path: Path) -> None:
    run([sys.executable, "-c", EMULATE, copy, tmp_path], copy)


def test_the_example_at_the_end_runs(copy: Path) -> None:
    _, example = FENCE.findall(PAGE.partition("## Try it")[2])[0]
    run([sys.executable, "-c", example], copy)


def test_settings_page_lists_the_kind(copy: Path) -> None:
    code = "from docs.tools.settings import page; assert 'strain_gauge' in page()"
    run([sys.executable, "-c", code], copy)


def test_quantities_page_lists_the_channels(copy: Path) -> None:
    assert "| `strain` | `1` | `strain_gauge` |" in (copy / "docs" / "quantities.md").read_text()


def test_sources_of_the_page_pass_the_linter(copy: Path) -> None:
    files = [copy / change.path for change in changes() if change.language == "python"]
    config = ROOT / "pyproject.toml"
    # In the copy ruff does not know which packages are first-party, so it would sort them anew.
    check = [sys.executable, "-m", "ruff", "check", "--ignore", "I001"]
    run([*check, "--config", config, *files], copy)
    run([sys.executable, "-m", "ruff", "format", "--check", "--config", config, *files], copy)
