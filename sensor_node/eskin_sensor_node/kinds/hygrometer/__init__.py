"""A capacitive polymer that measures the humidity."""

from __future__ import annotations

from eskin_sensor_node.kinds.hygrometer.frontend import HygrometerFrontend
from eskin_sensor_node.kinds.hygrometer.physics import HygrometerWorld
from eskin_sensor_node.kinds.hygrometer.settings import HygrometerSection
from eskin_sensor_node.kinds.kind import Kind

HYGROMETER = Kind(
    settings=HygrometerSection,
    world=HygrometerWorld,
    frontend=HygrometerFrontend,
    samples_per_code=4,  # air changes slowly
)
