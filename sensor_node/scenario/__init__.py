"""Scenarios: TOML scripts of what touches a skin, when, and what surrounds it."""

from __future__ import annotations

from sensor_node.scenario.events import LABELS
from sensor_node.scenario.file import read_scenario, scenario_names
from sensor_node.scenario.script import Script
from sensor_node.scenario.stage import Stage
from sensor_node.scenario.stimulus import Stimulus

__all__ = ["LABELS", "Script", "Stage", "Stimulus", "read_scenario", "scenario_names"]
