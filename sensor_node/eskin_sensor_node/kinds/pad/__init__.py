"""A pressed pad of a skin."""

from __future__ import annotations

from eskin_sensor_node.kinds.kind import Kind
from eskin_sensor_node.kinds.pad.physics import PadWorld
from eskin_sensor_node.kinds.pad.settings import PadSection
from eskin_sensor_node.kinds.rc import RcFrontend

PAD = Kind(settings=PadSection, world=PadWorld, frontend=RcFrontend)
