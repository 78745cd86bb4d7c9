"""A coil of a skin."""

from __future__ import annotations

from eskin_sensor_node.kinds.coil.frontend import CoilFrontend
from eskin_sensor_node.kinds.coil.physics import CoilWorld
from eskin_sensor_node.kinds.coil.settings import CoilSection
from eskin_sensor_node.kinds.kind import Kind

COIL = Kind(settings=CoilSection, world=CoilWorld, frontend=CoilFrontend)
