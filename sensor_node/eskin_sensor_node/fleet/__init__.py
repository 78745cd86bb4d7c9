"""Many nodes in one process."""

from __future__ import annotations

from eskin_sensor_node.fleet.service import run as run_fleet

__all__ = ["run_fleet"]
