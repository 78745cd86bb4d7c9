"""A taxel's schedule from its settings."""

from __future__ import annotations

from typing import TYPE_CHECKING

from eskin_sensor_node.firmware.schedule import Schedule
from eskin_sensor_node.kinds.settings import period
from eskin_sensor_node.timebase import BILLION

if TYPE_CHECKING:
    from eskin_sensor_node.kinds.settings import TaxelSection
    from eskin_sensor_node.settings import SamplingSection


def build_schedule(taxel: TaxelSection, sampling: SamplingSection, most: int = 1000) -> Schedule:
    """When a taxel samples.

    Args:
        taxel: Its settings.
        sampling: The node's stretches.
        most: Samples of a channel in a frame, at most.
    """
    dt = period(taxel.sampling)
    if taxel.burst is None:
        return Schedule(dt, sampling.stretch, most)
    length, repeated = taxel.burst
    burst = max(1, round(length * BILLION / dt))
    return Schedule(dt, sampling.stretch, most, burst, round(repeated * BILLION))
