"""Frames that benchmarks bring to gateways and clouds."""

from __future__ import annotations

import functools
from itertools import pairwise
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from eskin.interval import Interval
from eskin.wire.frames import Frame, Grid, Layout, Patch, PatchSamples
from eskin.wire.messages import Position

if TYPE_CHECKING:
    from collections.abc import Sequence

NODE: Final = "fingertip"
START: Final = 1_790_000_000_000_000_000
"""First instant of boot 0, UTC ns."""
_LEAST_WIDTH: Final = 64.0
_ERROR: Final = 4000
_SHAPES: Final = 64
"""Frames with other samples; they repeat after these."""
_DAY: Final = 86_400_000_000_000


class Case(NamedTuple):
    """Frames of one size.

    Attributes:
        name: What they are.
        columns: Of each patch; all are on one page.
        rows: Of each frame.
        period: From row to row, ns.
    """

    name: str
    columns: tuple[int, ...]
    rows: int
    period: int

    @property
    def samples(self) -> int:
        """Of a frame."""
        return sum(self.columns) * self.rows


FEW: Final = Case("4 channels, 125 rows", (4,), 125, 1_000_000)
"""500 samples in about 600 bytes."""
HAND: Final = Case("13 patches, 83 channels, 12 rows", (7,) * 5 + (6,) * 8, 12, 4_000_000)
SKIN: Final = Case("30 patches of 64 channels, 5 rows", (64,) * 30, 5, 20_000_000)


@functools.cache
def descriptions(case: Case) -> tuple[bytes, ...]:
    """The messages that describe the skin: its layout comes last."""
    patches, layout = _skin(case)
    return (*(each.encode() for each in patches), layout.encode())


def frame(case: Case, position: Position, first: int) -> bytes:
    """A frame; only its position and time are made for each anew.

    Args:
        case: Its size.
        position: Boot and sequence.
        first: Its first instant, UTC ns.
    """
    _, layout = _skin(case)
    samples = _shapes(case)[position.sequence % _SHAPES]
    ticks = position.sequence * case.rows * case.period
    grid, time = Grid(0, case.period, 0, case.rows, 1.0), (first, first + _ERROR)
    return Frame(position, layout.content_hash, 0, ticks, time, (grid,), samples).encode()


def say(case: Case, count: int, *, boot: int) -> list[tuple[str, bytes]]:
    """What a node says in one boot: frames one after the other, each with the node."""
    first, stretch = START + boot * _DAY, case.rows * case.period
    return [
        (NODE, frame(case, Position(boot, number), first + number * stretch))
        for number in range(count)
    ]


@functools.cache
def _skin(case: Case) -> tuple[Sequence[Patch], Layout]:
    patches = [
        Patch(f"p{k}", "pressure", "Pa", tuple(f"p{k}-{c}" for c in range(size)), _LEAST_WIDTH)
        for k, size in enumerate(case.columns)
    ]
    return patches, Layout(tuple(each.content_hash for each in patches), (len(patches),))


@functools.cache
def _shapes(case: Case) -> list[tuple[PatchSamples, ...]]:
    """Samples that walk at random."""
    random, total = np.random.default_rng(1), sum(case.columns)
    steps = random.normal(0.0, _LEAST_WIDTH / 8, (_SHAPES * case.rows, total))
    lo = random.normal(1000.0, 100.0, total) + np.cumsum(steps, axis=0)
    hi = lo + _LEAST_WIDTH * (1.0 + random.random(lo.shape) / 8)
    ends = np.cumsum((0, *case.columns))
    return [
        tuple(
            PatchSamples.pack(
                Interval(lo[rows, begin:end], hi[rows, begin:end]),
                _LEAST_WIDTH,
                patch=patch,
                grid=0,
                first_row=0,
            )
            for patch, (begin, end) in enumerate(pairwise(ends))
        )
        for k in range(_SHAPES)
        for rows in (slice(k * case.rows, (k + 1) * case.rows),)
    ]
