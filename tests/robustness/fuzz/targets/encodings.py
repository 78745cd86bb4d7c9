"""The sample codec: any bounds, written by both encoders."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from eskin.interval import Interval
from eskin.wire.frames import Sampling
from tests.robustness.fuzz.mutations.octets import mutate_octets
from tests.robustness.fuzz.target import Target
from tests.robustness.fuzz.targets.frame import check_encoders

if TYPE_CHECKING:
    from pathlib import Path

MOST = 8


def make(_: Path) -> Target:
    """The input is a byte for the least width, and pairs of float64; the encoders only widen."""
    pairs = ([1.0, 2.0], [-np.inf, np.inf], [5e-324, 1e-310], [-1.7e308, 1.7e308], [0.0, 0.0])
    widths = (0, 64, 128, 192, 255)
    seeds = [
        bytes([width]) + np.array(pair * 3, "<f8").tobytes()
        for width, pair in zip(widths, pairs, strict=True)
    ]
    return Target(tuple(seeds), mutate_octets, check)


def check(data: bytes) -> None:
    """Write and read."""
    numbers = np.frombuffer(data[1 : 1 + (len(data) - 1) // 16 * 16], "<f8")[: 2 * MOST]
    numbers = np.where(np.isnan(numbers), 0.0, numbers).reshape(-1, 2)
    lo, hi = numbers.min(axis=1, initial=np.inf), numbers.max(axis=1, initial=-np.inf)
    valid = (lo < np.inf) & (hi > -np.inf)
    lo, hi = lo[valid], hi[valid]
    if lo.size:
        values = Interval(lo.reshape(-1, 1), hi.reshape(-1, 1))
        check_encoders(values, Sampling(lo.size, 1), math.ldexp(1.0, 7 * (data[0] - 128)))
