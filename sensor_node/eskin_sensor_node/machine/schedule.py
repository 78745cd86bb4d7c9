"""A taxel's schedule from its settings."""

from __future__ import annotations

from typing import TYPE_CHECKING

from eskin_sensor_node.firmware.schedule import Schedule
from eskin_sensor_node.kinds.settings import period
from eskin_sensor_node.timebase import BILLION

if TYPE_CHECKING:
    from eskin_sensor_node.kinds.settings import TaxelSection


def build_schedule(taxel: TaxelSection, block: int) -> Schedule:
    """When the taxel samples; ``block``: samples in a block."""
    dt = period(taxel.sampling)
    if taxel.burst is None:
        return Schedule(dt, block)
    length, repeated = taxel.burst
    return Schedule(dt, block, max(1, round(length * BILLION / dt)), round(repeated * BILLION))
