"""A capacitance, by formula or out of a recording."""

from __future__ import annotations

from eskin_sensor_node.kinds.capacitive.physics import CapacitiveWorld, RecordedCapacitanceWorld
from eskin_sensor_node.kinds.capacitive.settings import (
    CapacitiveSection,
    RecordedCapacitanceSection,
)
from eskin_sensor_node.kinds.kind import Kind
from eskin_sensor_node.kinds.rc import RcFrontend

CAPACITIVE = Kind(settings=CapacitiveSection, world=CapacitiveWorld, frontend=RcFrontend)
RECORDED_CAPACITANCE = Kind(
    settings=RecordedCapacitanceSection, world=RecordedCapacitanceWorld, frontend=RcFrontend
)
