"""The analogue chain with its true parts, down to the ADC's codes (Fig. 3 of the paper)."""

from __future__ import annotations

from eskin_sensor_node.frontend.amplified import Digitised, Frontend
from eskin_sensor_node.frontend.chain import build_frontend

__all__ = ["Digitised", "Frontend", "build_frontend"]
