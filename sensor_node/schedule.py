"""When a taxel's samples are taken, and which of them make a block."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Self

import numpy as np

from sensor_node.constants import SECOND
from sensor_node.taxels import HybridSection, period

if TYPE_CHECKING:
    from eskin.interval import Floats
    from sensor_node.taxels import AnyTaxel


@dataclass(frozen=True, slots=True)
class Frame:
    """The samples of one block.

    Attributes:
        number: Counts the taxel's frames.
        first: Number of the first sample.
        start: Ticks of the first sample.
        trigger: Ticks of the burst's trigger; 0 where sampling never pauses.
        n: Samples.
        dt: Sampling period in ns.
        closes: Whether sampling pauses after it.
    """

    number: int
    first: int
    start: int
    trigger: int
    n: int
    dt: int
    closes: bool

    @property
    def end(self) -> int:
        """Ticks at which the frame is complete."""
        return self.start + self.n * self.dt

    @property
    def seconds(self) -> Floats:
        """Instants since the trigger."""
        ticks = self.start - self.trigger + self.dt * np.arange(self.n, dtype=np.int64)
        return np.asarray(ticks / SECOND)


@dataclass(frozen=True, slots=True)
class Schedule:
    """Equally spaced samples, without end or in bursts.

    Attributes:
        dt: Sampling period in ns.
        block: Samples in a block.
        burst: Samples in a burst; 0 where sampling never pauses.
        pause: ns from trigger to trigger.
    """

    dt: int
    block: int
    burst: int = 0
    pause: int = 0

    @classmethod
    def of(
        cls,
        taxel: AnyTaxel,
        block: int,
    ) -> Self:
        """The schedule of a taxel."""
        dt = period(taxel.sampling)
        if not isinstance(taxel, HybridSection):
            return cls(dt, block)
        burst = max(1, round(taxel.burst_s * SECOND / dt))
        return cls(dt, block, burst, max(burst * dt, round(taxel.burst_period_s * SECOND)))

    def frame(self, number: int) -> Frame:
        """The frame of a number."""
        if self.burst == 0:
            first = number * self.block
            return Frame(number, first, first * self.dt, 0, self.block, self.dt, closes=False)
        a_burst = -(-self.burst // self.block)
        burst, part = divmod(number, a_burst)
        trigger, before = burst * self.pause, part * self.block
        n = min(self.block, self.burst - before)
        first, start = burst * self.burst + before, trigger + before * self.dt
        return Frame(number, first, start, trigger, n, self.dt, closes=part == a_burst - 1)

    def ticks(self, sample: int) -> int:
        """When a sample is taken."""
        if self.burst == 0:
            return sample * self.dt
        burst, inside = divmod(sample, self.burst)
        return burst * self.pause + inside * self.dt
