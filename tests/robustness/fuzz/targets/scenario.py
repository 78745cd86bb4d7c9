"""Scenario files."""

from __future__ import annotations

from typing import TYPE_CHECKING

from eskin_sensor_node.world.scenario import read_scenario
from eskin_sensor_node.world.scenario.file import scenario_names, scenario_text

from eskin.errors import ScenarioError
from tests.robustness.fuzz.mutations.texts import mutate_text
from tests.robustness.fuzz.target import Target
from tests.robustness.fuzz.targets.settings import require_line

if TYPE_CHECKING:
    from pathlib import Path


def make(folder: Path) -> Target:
    """Only `ScenarioError`."""
    path = folder / "scenario.toml"

    def check(data: bytes) -> None:
        path.write_bytes(data)
        try:
            read_scenario(str(path))
        except ScenarioError as error:
            require_line(str(error))

    return Target(
        tuple(scenario_text(name).encode() for name in scenario_names()), mutate_text, check
    )
