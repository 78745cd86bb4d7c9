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
    from eskin_sensor_node.settings import SamplingSection


class Setting(NamedTuple):
    """One taxel's; equal ones give equal bytes from equal parts, however they came about.

    Attributes:
        gain: Of the amplifier.
        smoothing: Weight of the past in the samples in which peaks are sought.
        mode: What is sent, see `eskin_sensor_node.firmware.channel`.
        thresholds: Least prominence of each channel's peaks; 0 where there are none.
        timing: Period, stretch, most samples of a frame, burst, pause and origin of its schedule,
            the first origin that has the same samples.
        first: Number of its next sample.
    """

    gain: float
    smoothing: float
    mode: str
    thresholds: tuple[float, ...]
    timing: tuple[int, int, int, int, int, int]
    first: int

    @property
    def schedule(self) -> Schedule:
        """When it samples."""
        return Schedule(*self.timing)


def designed(taxel: TaxelSection, sampling: SamplingSection, most: int) -> Setting:
    """The setting of the design; ``most``: samples of a channel in a frame, at most."""
    schedule = build_schedule(taxel, sampling, most)
    thresholds = tuple(taxel.prominence(name) or 0.0 for name in taxel.units)
    return Setting(1.0, 0.0, SAMPLES, thresholds, _timing(schedule, schedule.origin), 0)


def setting_of(unit: ControlUnit, following: Frame) -> tuple[Setting, int]:
    """How a control unit is set.

    Args:
        unit: One that does not adapt by itself.
        following: Its next frame.

    Returns:
        Its setting, and how many samples its schedule has before the unit's first one.
    """
    schedule = unit.schedule
    step, a_lap = (schedule.pause, schedule.burst) if schedule.burst else (schedule.dt, 1)
    laps, origin = divmod(schedule.origin, step)
    setting = Setting(
        unit.adaptation.gain,
        unit.smoothing,
        unit.mode,
        tuple(channel.threshold for channel in unit.units),
        _timing(schedule, origin),
        following.first + laps * a_lap,
    )
    return setting, laps * a_lap


def _timing(schedule: Schedule, origin: int) -> tuple[int, int, int, int, int, int]:
    return (
        schedule.dt,
        schedule.stretch,
        schedule.most,
        schedule.burst,
        schedule.pause,
        origin,
    )


def longest_region(taxel: TaxelSection, dt: int) -> int:
    """Samples, one each ``dt`` ns, after which a taxel's undecided peaks are reported."""
    return max(2, round(taxel.longest_region_s * BILLION) // dt)
