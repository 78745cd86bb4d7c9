"""Metal before a coil, by formula or out of a recording."""

from __future__ import annotations

from eskin_sensor_node.kinds.inductive.physics import InductiveWorld, RecordedInductanceWorld
from eskin_sensor_node.kinds.inductive.settings import InductiveSection, RecordedInductanceSection
from eskin_sensor_node.kinds.kind import Kind
from eskin_sensor_node.kinds.lc import LcFrontend

INDUCTIVE = Kind(settings=InductiveSection, world=InductiveWorld, frontend=LcFrontend)
RECORDED_INDUCTANCE = Kind(
    settings=RecordedInductanceSection, world=RecordedInductanceWorld, frontend=LcFrontend
)
