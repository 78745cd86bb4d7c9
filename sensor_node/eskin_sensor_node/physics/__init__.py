"""The world: true parts and true signals, which no firmware ever sees."""

from __future__ import annotations

from eskin_sensor_node.physics.signals import Signals
from eskin_sensor_node.physics.world import World, build_world

__all__ = ["Signals", "World", "build_world"]
