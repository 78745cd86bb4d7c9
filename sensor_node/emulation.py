"""One emulated taxel: its world and analogue chain before, its control unit behind the ADC."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from sensor_node.firmware import ControlUnit
from sensor_node.frontend import build_frontend
from sensor_node.physics import build_world
from sensor_node.schedule import Schedule
from sensor_node.truth import TrueBlock

if TYPE_CHECKING:
    from collections.abc import Callable

    from eskin.messages import ChannelInfo, Encoding, Message, Position
    from sensor_node.clock import Clock
    from sensor_node.schedule import Frame
    from sensor_node.taxels import AnyTaxel


class EmulatedTaxel:
    """Samples one taxel, frame by frame.

    Args:
        taxel: Its data sheet.
        seed: Draws the true parts, the same at each boot.
        noise_seed: Draws the noise: each frame's depends on its number alone.
        clock: The node's clock.
        block: Samples in a block.
        encoding: How blocks write their bounds.
        position: Gives the next message's position.
    """

    def __init__(
        self,
        taxel: AnyTaxel,
        *,
        seed: tuple[int, ...],
        noise_seed: tuple[int, ...],
        clock: Clock,
        block: int,
        encoding: Encoding,
        position: Callable[[], Position],
    ) -> None:
        parts = np.random.default_rng(seed)
        self._world = build_world(taxel, parts)
        self._frontend = build_frontend(taxel, parts)
        self._noise_seed = noise_seed
        self._clock = clock
        self._schedule = Schedule.of(taxel, block)
        self._control_unit = ControlUnit(
            taxel,
            schedule=self._schedule,
            encoding=encoding,
            enclosure=clock.enclosure,
            position=position,
        )
        self.next: Frame = self._schedule.frame(0)

    @property
    def channels(self) -> tuple[ChannelInfo, ...]:
        """What it measures."""
        return self._control_unit.channels

    def sample(self) -> tuple[list[Message], list[TrueBlock]]:
        """Take the next frame: what the node says of it, and the truth behind its blocks."""
        frame = self.next
        random = np.random.default_rng((*self._noise_seed, frame.number))
        signals = self._world.signals(frame.seconds, random)
        digitised = self._frontend.digitise(signals.sensed, random)
        truth = signals.truth | digitised.truth
        blocks, peaks = self._control_unit.process(frame, digitised.codes)
        time = self._clock.true_time(frame.start)
        true_blocks = [
            TrueBlock(block.position, block.channel, time, frame.dt, truth[quantity])
            for quantity, block in blocks.items()
        ]
        self.next = self._schedule.frame(frame.number + 1)
        return [*blocks.values(), *peaks], true_blocks

    def skip(self, ticks: int) -> tuple[list[Message], int]:
        """Pass over all frames that begin before a moment.

        Returns:
            The peaks that stay undecided, and how many samples were lost, over all channels.
        """
        lost = 0
        while self.next.start < ticks:
            lost += self.next.n
            self.next = self._schedule.frame(self.next.number + 1)
        peaks = self._control_unit.skip(lost)
        return list(peaks), lost * len(self.channels)

    def finish(self) -> list[Message]:
        """The peaks that stay undecided at the end."""
        return list(self._control_unit.skip(0))
