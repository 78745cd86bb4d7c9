"""A series: samples where they are few, else the hull of each bucket's samples."""

from __future__ import annotations

import math
from dataclasses import dataclass
from fractions import Fraction
from typing import TYPE_CHECKING, Final, Literal

import numpy as np
from sqlalchemy import func, select

from cloud.query.span import (
    Samples,
    Summary,
    gather,
    inside,
    read_blocks,
    summarise,
    touching,
)
from cloud.query.window import Window
from cloud.store.schema import blocks

if TYPE_CHECKING:
    from numpy.typing import NDArray
    from sqlalchemy import Connection, RowMapping

    from eskin.interval import Floats

_EXACT: Final = 2**53
"""JavaScript keeps integers up to here."""


@dataclass(frozen=True, slots=True)
class Series:
    """A window of one channel, fit to be drawn.

    Attributes:
        node: Node.
        channel: Channel.
        unit: UCUM code.
        coverage: Probability with which each entry's interval encloses what it speaks of.
        resolution: ``sample``: each entry is one sample at its instant. ``hull``: each entry is
            the hull of all samples in ``[t, t + dt)``.
        t0: UTC ns.
        t: Entries' times in ns after ``t0``, each a float64's integer.
        lo: Lower bounds; both infinite where nothing is known.
        hi: Upper bounds.
        dt: Sampling period, or width of the buckets, in ns.
        time_error: How far a sample's true moment may lie from its time, in ns.
    """

    node: str
    channel: str
    unit: str
    coverage: float
    resolution: Literal["sample", "hull"]
    t0: int
    t: NDArray[np.int64]
    lo: Floats
    hi: Floats
    dt: int
    time_error: int


def read_series(
    connection: Connection, channel: RowMapping, window: Window, *, points: int
) -> Series:
    """Answer a question for a series.

    Args:
        connection: Reads one state of the store.
        channel: The channel's row.
        window: When.
        points: Samples that are answered as they are; beyond, buckets.
    """
    summary = summarise(connection, channel, window)
    if summary.samples <= points:
        found = [b for part in read_blocks(connection, touching(channel, window)) for b in part]
        samples = gather(found, window)
        if samples.t.size == 0 or int(samples.t[-1] - samples.t[0]) < _EXACT // 2:
            return _as_samples(channel, window, samples, summary)
    return _as_hull(connection, channel, window, points, summary)


def _as_samples(channel: RowMapping, window: Window, samples: Samples, summary: Summary) -> Series:
    t0 = int(samples.t[0]) if samples.t.size else window.start
    at = np.flatnonzero(samples.breaks) if samples.t.size else np.empty(0, np.int64)
    return Series(
        node=channel["node"],
        channel=channel["channel"],
        unit=channel["unit"],
        coverage=summary.coverage,
        resolution="sample",
        t0=t0,
        t=np.insert(samples.t, at + 1, samples.t[at] + samples.dt[at]) - t0,
        lo=np.insert(samples.lo, at + 1, -np.inf),
        hi=np.insert(samples.hi, at + 1, np.inf),
        dt=summary.dt,
        time_error=summary.error,
    )


def _as_hull(
    connection: Connection, channel: RowMapping, window: Window, points: int, summary: Summary
) -> Series:
    width = bucket_width(window.span, points)
    buckets = _Buckets(window.start, width, -(-window.span // width))
    # The last bucket may reach beyond the end: it is the hull of all that it claims to span.
    whole = Window(window.start, min(window.start + width * buckets.count, 2**63 - 1))
    here = touching(channel, whole)
    b = blocks.c
    bucket = (b.t - whole.start) // width
    alone = inside(whole) & (bucket == (b.t_end - whole.start) // width)
    bounds = select(bucket, func.min(b.lo), func.max(b.hi), func.sum(b.n))
    for index, lo, hi, n in connection.execute(bounds.where(here, alone).group_by(bucket)):
        buckets.add_bounds(index, lo, hi, int(n))
    for part in read_blocks(connection, here & ~alone):
        buckets.add_samples(gather(part, whole))
    if whole.end > window.end:
        summary = summarise(connection, channel, whole)
    empty = buckets.n == 0
    return Series(
        node=channel["node"],
        channel=channel["channel"],
        unit=channel["unit"],
        coverage=union_coverage(summary.coverage, int(buckets.n.max(initial=0))),
        resolution="hull",
        t0=window.start,
        t=np.arange(buckets.count, dtype=np.int64) * width,
        lo=np.where(empty, -np.inf, buckets.lo),
        hi=np.where(empty, np.inf, buckets.hi),
        dt=width,
        time_error=summary.error,
    )


class _Buckets:
    """Hulls that grow; an empty one is reversed."""

    def __init__(self, start: int, width: int, count: int) -> None:
        self.start, self.width, self.count = start, width, count
        self.lo = np.full(count, np.inf)
        self.hi = np.full(count, -np.inf)
        self.n = np.zeros(count, np.int64)

    def add_bounds(self, index: int, lo: float, hi: float, n: int) -> None:
        self.lo[index] = min(self.lo[index], lo)
        self.hi[index] = max(self.hi[index], hi)
        self.n[index] += n

    def add_samples(self, samples: Samples) -> None:
        index = (samples.t - self.start) // self.width
        np.minimum.at(self.lo, index, samples.lo)
        np.maximum.at(self.hi, index, samples.hi)
        np.add.at(self.n, index, 1)


def bucket_width(span: int, points: int) -> int:
    """The least width for which ``points`` buckets span the window, in ns.

    Every bucket's start is then an integer that a float64 keeps exact.
    """
    width = max(1, -(-span // points))
    grain = 1
    while width * points >= _EXACT * grain:
        grain *= 2
    return -(-width // grain) * grain


def union_coverage(coverage: float, n: int) -> float:
    """Union bound: all of n samples are enclosed with ``1 - n·(1 - coverage)`` at least.

    Rounded down, and not below 0; certainty stays certainty.
    """
    if coverage == 1.0 or n == 0:
        return coverage
    exact = 1 - n * (1 - Fraction(coverage))
    if exact <= 0:
        return 0.0
    nearest = float(exact)
    return math.nextafter(nearest, 0.0) if Fraction(nearest) > exact else nearest


def reduce_samples(samples: Samples, points: int) -> tuple[Samples, int, int]:
    """The hulls of runs of equally many samples, at most ``points`` of them.

    Returns:
        One entry a run, the run's length in samples, and the samples of the largest run.
    """
    n = samples.t.size
    stride = -(-n // points)
    at = np.arange(0, n, stride)
    lo, hi = np.minimum.reduceat(samples.lo, at), np.maximum.reduceat(samples.hi, at)
    return Samples(samples.t[at], samples.dt[at], lo, hi), stride, min(stride, n)
