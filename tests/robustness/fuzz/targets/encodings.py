"""The typed arrays: any bounds, written by the contract's encoder."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from eskin.interval import Interval
from eskin.tube import Tube
from eskin.wire.messages import Block, Encoding, Position
from tests.robustness.fuzz.mutations.octets import mutate_octets
from tests.robustness.fuzz.target import Target

if TYPE_CHECKING:
    from pathlib import Path

MOST = 8


def make(_: Path) -> Target:
    """The input is pairs of float64; every encoding only widens, and says by how much."""
    pairs = ([1.0, 2.0], [-np.inf, np.inf], [5e-324, 1e-310], [-1.7e308, 1.7e308], [0.0, 0.0])
    seeds = [np.array(pair * 3, "<f8").tobytes() for pair in pairs]
    return Target(tuple(seeds), mutate_octets, check)


def check(data: bytes) -> None:
    """Write and read."""
    numbers = np.frombuffer(data[: len(data) // 16 * 16], "<f8")[: 2 * MOST]
    numbers = np.where(np.isnan(numbers), 0.0, numbers).reshape(-1, 2)
    lo, hi = numbers.min(axis=1, initial=np.inf), numbers.max(axis=1, initial=-np.inf)
    valid = (lo < np.inf) & (hi > -np.inf)
    lo, hi = lo[valid], hi[valid]
    if not lo.size:
        return
    tube = Tube((0, 5), 10, Interval(lo, hi), "F", 1.0)
    for encoding in Encoding:
        block = Block.pack(Position(1, 7), "t01.capacitance", 0, tube, encoding)
        _check(Block.decode(block.encode()), lo, hi)


def _check(block: Block, lo: np.ndarray, hi: np.ndarray) -> None:
    written = block.tube.values
    assert (written.inf <= lo).all(), "a lower bound rose"
    assert (written.sup >= hi).all(), "an upper bound fell"
    with np.errstate(invalid="ignore", over="ignore"):
        moved = np.concatenate([lo - written.inf, written.sup - hi])
    finite = moved[np.isfinite(moved)]
    assert block.widening >= finite.max(initial=0.0), "it widens by more than it says"
