"""The firmware's encoder of samples, compiled: equal to the byte."""

from __future__ import annotations

from math import ldexp
from typing import TYPE_CHECKING

import numpy as np

from eskin.interval import Interval
from eskin.wire.frames import Sampling, encode_samples

if TYPE_CHECKING:
    from collections.abc import Sequence


def compiled_encode(
    lows: Sequence[float],
    highs: Sequence[float],
    rows: int,
    columns: int,
    first_row: int,
    strides: Sequence[int],
    finest: int,
) -> tuple[int, int, bytes]:
    """Encode a matrix of samples, as `eskin_sensor_node.firmware.assembler.encode` does."""
    values = Interval(np.asarray(lows), np.asarray(highs)).reshape(rows, columns)
    # The least width whose finest exponent this is.
    width = ldexp(1.0, finest + 6)
    return encode_samples(values, Sampling(rows, columns, first_row, bytes(strides)), width)
