"""The setting of a taxel and its schedule: what nodes of a cohort have in common."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from eskin_sensor_node.firmware.channel import SAMPLES
from eskin_sensor_node.firmware.schedule import Schedule
from eskin_sensor_node.machine.schedule import build_schedule
from eskin_sensor_node.timebase import BILLION

if TYPE_CHECKING:
    from eskin_sensor_node.firmware.control_unit import ControlUnit
    from eskin_sensor_node.firmware.schedule import Frame
    from eskin_sensor_node.kinds.settings import TaxelSection


class Setting(NamedTuple):
    """One taxel's; equal ones give equal bytes from equal parts, however they came about.

    Attributes:
        gain: Of the amplifier.
        smoothing: Weight of the past in the samples in which peaks are sought.
        mode: What is sent, see `eskin_sensor_node.firmware.channel`.
        thresholds: Least prominence of each channel's peaks; 0 where there are none.
        timing: Period, block, burst, pause and origin of its schedule, the first origin that has
            the same samples.
        number: Its next frame's.
    """

    gain: float
    smoothing: float
    mode: str
    thresholds: tuple[float, ...]
    timing: tuple[int, int, int, int, int]
    number: int

    @property
    def schedule(self) -> Schedule:
        """When it samples."""
        return Schedule(*self.timing)


def designed(taxel: TaxelSection, block: int) -> Setting:
    """The setting of the design; ``block``: samples in a block."""
    schedule = build_schedule(taxel, block)
    timing = schedule.dt, schedule.block, schedule.burst, schedule.pause, schedule.origin
    return Setting(
        1.0, 0.0, SAMPLES, tuple(taxel.prominence(name) or 0.0 for name in taxel.units), timing, 0
    )


def setting_of(unit: ControlUnit, following: Frame) -> tuple[Setting, int]:
    """How a control unit is set.

    Args:
        unit: One that does not adapt by itself.
        following: Its next frame.

    Returns:
        Its setting, and how many samples its schedule has before the unit's first one.
    """
    schedule = unit.schedule
    a_lap, step = schedule.block, schedule.block * schedule.dt
    frames = 1
    if schedule.burst:
        a_lap, step, frames = schedule.burst, schedule.pause, -(-schedule.burst // schedule.block)
    laps, origin = divmod(schedule.origin, step)
    setting = Setting(
        unit.adaptation.gain,
        unit.smoothing,
        unit.mode,
        tuple(channel.threshold for channel in unit.units),
        (schedule.dt, schedule.block, schedule.burst, schedule.pause, origin),
        following.number + laps * frames,
    )
    return setting, laps * a_lap


def longest_region(taxel: TaxelSection, dt: int) -> int:
    """Samples, one each ``dt`` ns, after which a taxel's undecided peaks are reported."""
    return max(2, round(taxel.longest_region_s * BILLION) // dt)
