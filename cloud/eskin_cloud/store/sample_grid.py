"""The grid of the pyramid: where tiles and chunks lie in time.

A level's tiles are ``2^level`` ns wide and begin at whole multiples of that, counted from 1970; the
next level's are four times as wide. A chunk holds 256 neighbouring tiles of a level in one row.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Iterable

STEP: Final = 2
"""Levels are so many powers of two apart."""
CHUNK: Final = 8
"""A chunk is ``2^CHUNK`` tiles."""
TOP: Final = 50
"""No level is above: some thousand of its tiles reach over all times that there are."""
MOST_CHUNKS: Final = 64
"""A message's samples touch no more. Five hundred times slower than the first ones, none do."""
MOST_SPAN: Final = 4096
"""Nor do they reach over more: whatever is asked of a chunk between two of them skips them."""
_SAMPLES: Final = 64


def grain_of(dt: int) -> int:
    """The lowest level of a channel: tiles of 64 to 256 samples; those of all channels nest.

    Args:
        dt: Sampling period of its first block, ns.
    """
    bits = (_SAMPLES * dt - 1).bit_length()
    return min(bits + bits % STEP, TOP)


class SampleGrid(NamedTuple):
    """When the samples of a row were taken: in even steps, with nothing between them.

    Attributes:
        t: The first one, UTC ns.
        dt: Sampling period, ns.
        n: How many.
        messages: In how many messages they came.
    """

    t: int
    dt: int
    n: int
    messages: int = 1

    def chunks(self, grain: int) -> Iterable[int]:
        """The chunks of a level that hold any of them, each once."""
        bits = grain + CHUNK
        if self.dt >> bits == 0:
            return self._span(bits)
        return (moment >> bits for moment in range(self.t, self.t + self.dt * self.n, self.dt))

    def fits(self, grain: int) -> bool:
        """Whether a level has few chunks to make anew, and to look at, for each message."""
        span = len(self._span(grain + CHUNK))
        return (
            min(self.n, span) <= MOST_CHUNKS * self.messages and span <= MOST_SPAN * self.messages
        )

    def _span(self, bits: int) -> range:
        return range(self.t >> bits, (self.t + self.dt * (self.n - 1) >> bits) + 1)


def grain_for(grain: int, comb: SampleGrid) -> int:
    """The least level, from a channel's on, that fits a row's samples.

    Args:
        grain: The channel's lowest level.
        comb: The samples.
    """
    while not comb.fits(grain) and grain + STEP <= TOP:
        grain += STEP
    return grain
