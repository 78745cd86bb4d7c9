"""The control unit of Fig. 3: from codes to intervals, peaks, and the messages that tell them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from eskin.messages import Block, ChannelInfo, Peak
from eskin.peaks import PeakDetector
from eskin.tube import Tube
from sensor_node.constants import SECOND
from sensor_node.firmware.inversion import build_inversion

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from eskin.interval import Interval
    from eskin.messages import Encoding, Position
    from eskin.peaks import PeakEvent
    from sensor_node.converter import Codes
    from sensor_node.schedule import Frame, Schedule
    from sensor_node.taxels import AnyTaxel


@dataclass(frozen=True, slots=True)
class _Channel:
    """One quantity of the taxel."""

    quantity: str
    info: ChannelInfo
    detector: PeakDetector | None


class ControlUnit:
    """Measures one taxel.

    Args:
        taxel: Its data sheet; never its true parts.
        schedule: When its samples are taken.
        encoding: How blocks write their bounds.
        enclosure: Gives earliest and latest UTC (ns) of a moment in ticks.
        position: Gives the next message's position.
    """

    def __init__(
        self,
        taxel: AnyTaxel,
        *,
        schedule: Schedule,
        encoding: Encoding,
        enclosure: Callable[[int], tuple[int, int]],
        position: Callable[[], Position],
    ) -> None:
        self._inversion = build_inversion(taxel)
        self._schedule = schedule
        self._encoding = encoding
        self._enclosure = enclosure
        self._position = position
        longest = max(2, round(taxel.longest_region_s * SECOND / schedule.dt))
        self._channels = [
            _Channel(
                quantity,
                ChannelInfo(f"{taxel.id}.{quantity}", unit, schedule.dt, taxel.noise.coverage),
                _detector(taxel.prominence(quantity), longest),
            )
            for quantity, unit in taxel.units.items()
        ]

    @property
    def channels(self) -> tuple[ChannelInfo, ...]:
        """What it measures."""
        return tuple(channel.info for channel in self._channels)

    def process(
        self, frame: Frame, codes: Mapping[str, Codes]
    ) -> tuple[dict[str, Block], list[Peak]]:
        """Measure one frame.

        Returns:
            Quantity to its block, and the peaks that are decided now.
        """
        measured = self._inversion.measure(codes)
        blocks = {
            channel.quantity: self._block(channel.info, frame, measured[channel.quantity])
            for channel in self._channels
        }
        peaks: list[Peak] = []
        for channel in self._channels:
            if channel.detector is not None:
                values = measured[channel.quantity]
                events = channel.detector.feed(values.inf.tolist(), values.sup.tolist())
                if frame.closes:
                    events += channel.detector.gap()
                peaks += [self._peak(channel.info, event) for event in events]
        return blocks, peaks

    def skip(self, samples: int) -> list[Peak]:
        """Say that samples are missing here.

        Returns:
            The peaks that stay undecided.
        """
        return [
            self._peak(channel.info, event)
            for channel in self._channels
            if channel.detector is not None
            for event in channel.detector.gap(samples)
        ]

    def _block(self, info: ChannelInfo, frame: Frame, values: Interval) -> Block:
        time = self._enclosure(frame.start)
        tube = Tube(time, frame.dt, values, info.unit, info.coverage)
        return Block.pack(self._position(), info.channel, frame.start, tube, self._encoding)

    def _peak(self, info: ChannelInfo, event: PeakEvent) -> Peak:
        earliest = self._enclosure(self._schedule.ticks(event.first))[0]
        latest = self._enclosure(self._schedule.ticks(event.last))[1]
        return Peak(
            position=self._position(),
            channel=info.channel,
            unit=info.unit,
            time=(earliest, latest),
            verdict=event.verdict,
            count=event.count,
            height=event.height,
            prominence=event.prominence,
            coverage=union_coverage(info.coverage, event.last - event.first + 1),
        )


def union_coverage(coverage: float, samples: int) -> float:
    """Probability that all samples hold at once, at least (union bound, rounded down)."""
    if coverage == 1.0:
        return 1.0
    # 1 - coverage is exact (Sterbenz) for any coverage from one half on.
    beyond = math.nextafter(samples * (1.0 - coverage), math.inf)
    return max(0.0, math.nextafter(1.0 - beyond, 0.0))


def _detector(prominence: float | None, longest: int) -> PeakDetector | None:
    if prominence is None:
        return None
    return PeakDetector(prominence, longest_region=longest)
