"""The grid of the pyramid: where tiles and chunks lie in time.

A level's tiles are ``2^level`` ns wide and begin at whole multiples of that, counted from 1970; the
next level's are four times as wide. A chunk holds 256 neighbouring tiles of a level in one row.
"""

from __future__ import annotations

from typing import Final

STEP: Final = 2
"""Levels are so many powers of two apart."""
CHUNK: Final = 8
"""A chunk is ``2^CHUNK`` tiles."""
TOP: Final = 50
"""No level is above: some thousand of its tiles reach over all times that there are."""
MOST_CHUNKS: Final = 64
"""One row's samples touch no more. Sampled five hundred times slower than the first, none does."""
_SAMPLES: Final = 64


def grain_of(dt: int) -> int:
    """The lowest level of a channel: tiles of 64 to 256 samples; those of all channels nest.

    Args:
        dt: Sampling period of its first block, ns.
    """
    bits = (_SAMPLES * dt - 1).bit_length()
    return min(bits + bits % STEP, TOP)


def grain_for(grain: int, first: int, last: int) -> int:
    """The least level, from a channel's on, of which a stretch of time touches few chunks.

    Args:
        grain: The channel's lowest level.
        first: UTC ns.
        last: UTC ns, included.
    """
    while len(chunks_between(grain, first, last)) > MOST_CHUNKS and grain + STEP <= TOP:
        grain += STEP
    return grain


def chunks_between(grain: int, first: int, last: int) -> range:
    """The chunks of the lowest level that a stretch of time touches.

    Args:
        grain: The channel's lowest level.
        first: UTC ns.
        last: UTC ns, included.
    """
    return range(first >> (grain + CHUNK), (last >> (grain + CHUNK)) + 1)
