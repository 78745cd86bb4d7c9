"""One pass over a tube, compiled: a rise of p above the lowest valley, then a fall of p below.

The certain pass takes upper bounds for valleys and lower bounds for crests, the optimistic pass the
reverse.
"""

from __future__ import annotations

import math
from typing import Any, Final, NamedTuple

import numpy as np

from eskin.kernels.jit import inlined, part

NONE: Final = -1
"""The first sample of a pass that has none."""

PASS: Final = np.dtype(
    [
        ("first", np.int64),
        ("rising", np.int64),
        ("valley", np.float64),
        ("crest", np.float64),
        ("lowest", np.float64),
        ("floor", np.float64),
        ("ceiling", np.float64),
    ]
)
"""A `Pass` at rest between two pieces of a stream."""


class Pass(NamedTuple):
    """Where a pass stands.

    Attributes:
        first: The sample a: where the valley is, and its stretch begins.
        rising: Whether it rose p above the valley.
        valley: The lowest valley so far.
        crest: The highest crest since it rose.
        lowest: Least lower bound of the stretch.
        floor: Greatest lower bound of the stretch.
        ceiling: Greatest upper bound of the stretch.
    """

    first: int
    rising: bool
    valley: float
    crest: float
    lowest: float
    floor: float
    ceiling: float


@inlined
def nowhere() -> Pass:
    """A pass before its first sample: whatever comes is a lower valley."""
    return Pass(NONE, False, math.inf, -math.inf, math.inf, -math.inf, -math.inf)  # noqa: FBT003


@inlined
def begin(index: int, valley: float, lo: float, hi: float) -> Pass:
    """A stretch begins in a valley."""
    return Pass(index, False, valley, -math.inf, lo, lo, hi)  # noqa: FBT003


@inlined
def include(at: Pass, lo: float, hi: float) -> Pass:
    """The stretch takes a sample in."""
    return Pass(
        at.first,
        at.rising,
        at.valley,
        at.crest,
        min(at.lowest, lo),
        max(at.floor, lo),
        max(at.ceiling, hi),
    )


@inlined
def rise(at: Pass, crest: float) -> Pass:
    """The stretch has a new crest."""
    return Pass(at.first, True, at.valley, crest, at.lowest, at.floor, at.ceiling)  # noqa: FBT003


@inlined
def completes(at: Pass, valley: float, prominence: float) -> bool:
    """Whether a sample is the c of a peak."""
    return at.rising and reaches(at.crest, valley, prominence)


@inlined
def follow(
    at: Pass, index: int, valley: float, crest: float, lo: float, hi: float, prominence: float
) -> Pass:
    """The pass after a sample, already included, that completes no peak."""
    if at.rising:
        return rise(at, max(at.crest, crest))
    if reaches(crest, at.valley, prominence):
        return rise(at, crest)
    return begin(index, valley, lo, hi) if valley <= at.valley else at


@inlined
def reaches(high: float, low: float, prominence: float) -> bool:
    """Whether ``high - low >= prominence``, exactly: only a tie can hide behind the rounding."""
    difference = high - low
    return difference >= prominence and (difference != prominence or not_above(high, low))


@part
def not_above(high: float, low: float) -> bool:
    """Whether the rounded ``high - low`` is not above the true one (Dekker's FastTwoSum)."""
    difference = high - low
    if abs(high) >= abs(low):
        return (high - difference) - low >= 0.0
    return high - (difference + low) >= 0.0


@part
def wake(at: Any) -> Pass:
    """Read a pass at rest."""
    return Pass(at.first, at.rising != 0, at.valley, at.crest, at.lowest, at.floor, at.ceiling)


@part
def rest(at: Pass, to: Any) -> None:
    """Write a pass down."""
    to.first = at.first
    to.rising = at.rising
    to.valley = at.valley
    to.crest = at.crest
    to.lowest = at.lowest
    to.floor = at.floor
    to.ceiling = at.ceiling
