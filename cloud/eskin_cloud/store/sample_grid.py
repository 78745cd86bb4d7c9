"""The time grid of tiles and chunks.

A level's tiles are ``2^level`` ns wide and begin at multiples of that since 1970; the next level's
are four times as wide. A chunk holds 64 neighbouring tiles of a level, and all columns of a patch,
in one row.
"""

from __future__ import annotations

from typing import Final

STEP: Final = 2
"""Powers of two between levels."""
PATCH_CHUNK: Final = 6
"""A chunk is ``2^PATCH_CHUNK`` tiles."""
TOP: Final = 50
"""The highest level: some thousand of its tiles cover all 64-bit times."""
MOST_SPAN: Final = 4096
"""Most chunks that a row's samples may span."""
_SAMPLES: Final = 32


def patch_level(dt: int) -> int:
    """The lowest level of a patch: tiles of 32 to 128 samples a column; those of all patches nest.

    Args:
        dt: Period of its first frame, ns.
    """
    bits = (_SAMPLES * dt - 1).bit_length()
    return min(bits + bits % STEP, TOP)
