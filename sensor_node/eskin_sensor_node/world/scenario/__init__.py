"""Scenarios: TOML scripts of what touches a skin, when, and what surrounds it."""

from __future__ import annotations

from eskin_sensor_node.world.scenario.events import LABELS
from eskin_sensor_node.world.scenario.file import read_scenario, scenario_names
from eskin_sensor_node.world.scenario.script import Script
from eskin_sensor_node.world.scenario.stage import Stage
from eskin_sensor_node.world.scenario.stimulus import Stimulus

__all__ = ["LABELS", "Script", "Stage", "Stimulus", "read_scenario", "scenario_names"]
