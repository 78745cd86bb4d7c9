"""The ICM hybrid."""

from __future__ import annotations

from eskin_sensor_node.kinds.hybrid.frontend import HybridFrontend
from eskin_sensor_node.kinds.hybrid.physics import HybridWorld
from eskin_sensor_node.kinds.hybrid.settings import HybridSection
from eskin_sensor_node.kinds.kind import Kind

HYBRID = Kind(settings=HybridSection, world=HybridWorld, frontend=HybridFrontend)
