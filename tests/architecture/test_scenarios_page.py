"""Every key of a scenario is documented, the page is current, and what it shows can be played."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path
from typing import get_args

import pytest
from eskin_sensor_node.world.replay import Recorded
from eskin_sensor_node.world.scenario import Script, read_scenario
from eskin_sensor_node.world.scenario.events import AnyEvent
from eskin_sensor_node.world.scenario.script import VariationSection
from eskin_sensor_node.world.scenario.surroundings import AmbientSection, BioelectricSection
from eskin_sensor_node.world.skin import FaultSection, Shape

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "scenarios.md"
MODELS = [
    Script,
    VariationSection,
    AmbientSection,
    BioelectricSection,
    FaultSection,
    Recorded,
    *get_args(AnyEvent),
    *get_args(get_args(Shape)[0]),
]


@pytest.mark.parametrize("model", MODELS)
def test_every_key_has_its_help_and_stands_on_the_page(model: type[Script]) -> None:
    text = PAGE.read_text()
    for key, field in model.model_json_schema()["properties"].items():
        if "const" not in field:
            assert field.get("description"), key
            assert f"| `{key}` |" in text


def test_page_of_scenarios_is_current() -> None:
    command = [sys.executable, "-m", "docs.tools.scenarios"]
    page = subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True).stdout
    assert PAGE.read_text() == page, "python -m docs.tools.scenarios > docs/scenarios.md"


def test_example_of_the_page_can_be_played(tmp_path: Path) -> None:
    example = re.search(r"```toml\n(.*?)```", PAGE.read_text(), re.DOTALL)
    assert example is not None
    path = tmp_path / "example.toml"
    path.write_text(example[1])
    assert len(read_scenario(str(path)).event) == 1
