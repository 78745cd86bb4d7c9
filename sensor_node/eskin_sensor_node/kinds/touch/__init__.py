"""A touch that covers a plate."""

from __future__ import annotations

from eskin_sensor_node.kinds.kind import Kind
from eskin_sensor_node.kinds.touch.frontend import TouchFrontend
from eskin_sensor_node.kinds.touch.physics import TouchWorld
from eskin_sensor_node.kinds.touch.settings import TouchSection

TOUCH = Kind(settings=TouchSection, world=TouchWorld, frontend=TouchFrontend)
