"""Loading what reads frames before the first of them comes."""

from __future__ import annotations

import numpy as np

from eskin.interval import Interval
from eskin.wire.frames.column_hulls import ColumnHulls
from eskin.wire.frames.encoded_frame import EncodedFrame
from eskin.wire.frames.frame import Frame, Grid, PatchSamples
from eskin.wire.messages.header import Position


def warm_up() -> Frame:
    """Read a frame as a message is read; gives it."""
    values = Interval(np.zeros((2, 2)), np.ones((2, 2)))
    samples = PatchSamples.pack(values, 1.0, patch=0, grid=0, first_row=0)
    frame = Frame(Position(1, 1), bytes(32), 0, 0, (0, 0), (Grid(0, 1, 0, 2, 1.0),), (samples,))
    data = frame.encode()
    ColumnHulls.of(EncodedFrame.decode(data))
    return Frame.decode(data)
