"""A taxel's schedule from its settings."""

from __future__ import annotations

from typing import TYPE_CHECKING

from eskin_sensor_node.firmware.schedule import Schedule
from eskin_sensor_node.machine.crystal import BILLION
from eskin_sensor_node.taxels import HybridSection, period

if TYPE_CHECKING:
    from eskin_sensor_node.taxels import AnyTaxel


def build_schedule(taxel: AnyTaxel, block: int) -> Schedule:
    """When the taxel samples; ``block``: samples in a block."""
    dt = period(taxel.sampling)
    if not isinstance(taxel, HybridSection):
        return Schedule(dt, block)
    burst = max(1, round(taxel.burst_s * BILLION / dt))
    return Schedule(dt, block, burst, round(taxel.burst_period_s * BILLION))
