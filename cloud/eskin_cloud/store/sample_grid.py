"""The time grid of tiles and chunks.

A level's tiles are ``2^level`` ns wide and begin at multiples of that since 1970; the next level's
are four times as wide. A chunk holds 256 neighbouring tiles of a level in one row.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Iterable

STEP: Final = 2
"""Powers of two between levels."""
CHUNK: Final = 8
"""A chunk is ``2^CHUNK`` tiles."""
PATCH_CHUNK: Final = 6
"""A chunk of a patch, which holds all its columns, is ``2^PATCH_CHUNK`` tiles."""
TOP: Final = 50
"""The highest level: some thousand of its tiles cover all 64-bit times."""
MOST_CHUNKS: Final = 64
"""Most chunks that a message's samples may touch."""
MOST_SPAN: Final = 4096
"""Most chunks that a message's samples may span."""
_SAMPLES: Final = 64
_PATCH_SAMPLES: Final = 32


def base_level(dt: int, samples: int = _SAMPLES) -> int:
    """The lowest level of a channel: tiles of 64 to 256 samples; those of all channels nest.

    Args:
        dt: Sampling period of its first block, ns.
        samples: The fewest samples of a tile.
    """
    bits = (samples * dt - 1).bit_length()
    return min(bits + bits % STEP, TOP)


def patch_level(dt: int) -> int:
    """The lowest level of a patch: tiles of 32 to 128 samples a column.

    Args:
        dt: Period of its first frame, ns.
    """
    return base_level(dt, _PATCH_SAMPLES)


class SampleGrid(NamedTuple):
    """The times of a row's samples, in even steps.

    Attributes:
        t: The first one, UTC ns.
        dt: Sampling period, ns.
        n: How many.
        messages: Number of messages that held them.
    """

    t: int
    dt: int
    n: int
    messages: int = 1

    def chunks(self, grain: int) -> Iterable[int]:
        """The chunks of a level that hold samples, each once."""
        bits = grain + CHUNK
        if self.dt >> bits == 0:
            return self._span(bits)
        return (moment >> bits for moment in range(self.t, self.t + self.dt * self.n, self.dt))

    def fits(self, grain: int) -> bool:
        """Whether the samples touch and span few chunks of a level."""
        span = len(self._span(grain + CHUNK))
        return (
            min(self.n, span) <= MOST_CHUNKS * self.messages and span <= MOST_SPAN * self.messages
        )

    def _span(self, bits: int) -> range:
        return range(self.t >> bits, (self.t + self.dt * (self.n - 1) >> bits) + 1)


def level_for(grain: int, samples: SampleGrid) -> int:
    """The least level, from a channel's on, that fits a row's samples.

    Args:
        grain: The channel's lowest level.
        samples: The samples.
    """
    while not samples.fits(grain) and grain + STEP <= TOP:
        grain += STEP
    return grain
