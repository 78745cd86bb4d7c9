"""An electrode on the skin."""

from __future__ import annotations

from eskin_sensor_node.kinds.bioelectric.frontend import BioelectricFrontend
from eskin_sensor_node.kinds.bioelectric.physics import BioelectricWorld
from eskin_sensor_node.kinds.bioelectric.settings import BioelectricSection
from eskin_sensor_node.kinds.kind import Kind

BIOELECTRIC = Kind(
    settings=BioelectricSection, world=BioelectricWorld, frontend=BioelectricFrontend
)
