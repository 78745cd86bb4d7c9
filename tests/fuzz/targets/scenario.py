"""Scenario files."""

from __future__ import annotations

from typing import TYPE_CHECKING

from eskin.errors import ScenarioError
from sensor_node.scenario import read_scenario
from sensor_node.scenario.file import scenario_names, scenario_text
from tests.fuzz.mutations.texts import mutate_text
from tests.fuzz.target import Target
from tests.fuzz.targets.settings import require_line

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
