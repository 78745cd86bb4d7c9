"""What benchmarks of ingest bring."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from tests.unit.cloud.messages import START, block

if TYPE_CHECKING:
    from eskin.wire.messages import Encoding

SAMPLES: Final = 500
"""Of a block."""
_CHANNELS: Final = 4
Said = list[tuple[str, bytes]]
"""Messages, each with its node."""


def say(encoding: Encoding, blocks: int, *, boot: int) -> Said:
    """What a node says in one boot: blocks of four channels in turn."""
    random = np.random.default_rng(boot)
    said = []
    for number in range(blocks):
        lo = random.random(SAMPLES)
        first = START + (boot * blocks + number) // _CHANNELS * SAMPLES * 1_000_000
        one = block(
            number,
            lo,
            lo + 1e-3,
            boot=boot,
            time=(first, first),
            channel=f"t{number % _CHANNELS:02}.capacitance",
            encoding=encoding,
        )
        said.append(("fingertip", one.encode()))
    return said
