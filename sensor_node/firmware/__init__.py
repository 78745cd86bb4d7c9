"""The control unit: sees ADC codes and its calibration only, and says intervals and peaks."""

from __future__ import annotations

from sensor_node.firmware.control_unit import ControlUnit
from sensor_node.firmware.inversion import Inversion, build_inversion

__all__ = ["ControlUnit", "Inversion", "build_inversion"]
