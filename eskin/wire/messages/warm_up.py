"""Loading what reads messages before the first of them comes."""

from __future__ import annotations

import numpy as np

from eskin.interval import Interval
from eskin.tube import Tube
from eskin.wire.messages.block import Block
from eskin.wire.messages.encoding import Encoding
from eskin.wire.messages.fast_decode import scan
from eskin.wire.messages.header import Position


def warm_up() -> Block:
    """Read a block as a message is read; gives it.

    The first use of anything compiled loads it, and with it what the compiler needs: half a second
    for which the first message would wait, and 25 MB that it would seem to leave behind.
    """
    values = Interval(np.array([0.0, 1.0]), np.array([0.5, 1.5]))
    tube = Tube((0, 0), 1_000_000, values, "F", 1.0)
    data = Block.pack(Position(1, 1), "t01.capacitance", 0, tube, Encoding.Q16).encode()
    scan(data)
    return Block.decode(data)
