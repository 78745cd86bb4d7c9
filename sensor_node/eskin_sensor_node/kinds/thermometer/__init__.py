"""A platinum resistor that measures the temperature."""

from __future__ import annotations

from eskin_sensor_node.kinds.kind import Kind
from eskin_sensor_node.kinds.thermometer.frontend import ThermometerFrontend
from eskin_sensor_node.kinds.thermometer.physics import ThermometerWorld
from eskin_sensor_node.kinds.thermometer.settings import ThermometerSection

THERMOMETER = Kind(
    settings=ThermometerSection,
    world=ThermometerWorld,
    frontend=ThermometerFrontend,
    samples_per_code=8,  # air changes slowly
)
