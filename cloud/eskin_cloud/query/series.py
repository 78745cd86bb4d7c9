"""Read a series: samples if few, else the hull of each bucket."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from eskin.union_bound import union_coverage
from eskin_cloud.rollup.aggregates import longest_step
from eskin_cloud.rollup.hulls import EXACT, is_tiled, read_hulls
from eskin_cloud.rollup.samples import read_few

if TYPE_CHECKING:
    from numpy.typing import NDArray
    from sqlalchemy import Connection

    from eskin.interval import Floats
    from eskin_cloud.rollup.aggregates import Aggregates
    from eskin_cloud.rollup.buckets import Buckets
    from eskin_cloud.store.read.lookup import Channel
    from eskin_cloud.store.read.window import Window


@dataclass(frozen=True, slots=True)
class Series:
    """A window of one channel, to be drawn.

    Attributes:
        node: Node.
        channel: Channel.
        unit: UCUM code.
        coverage: Probability that each entry's interval encloses its true values.
        resolution: ``sample``: each entry is one sample at its instant. ``hull``: each entry is
            the hull of all samples in ``[t, t + dt)``.
        t0: UTC ns.
        t: Times in ns after ``t0``, each exact as a float64.
        lo: Lower bounds; infinite where unknown.
        hi: Upper bounds.
        dt: Sampling period, or width of the buckets, in ns.
        time_error: Greatest distance of a sample's true time from its stated time, ns.
        mean: Bounds of the mean of each entry's samples; ``None`` for samples.
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
    mean: tuple[Floats, Floats] | None = None


def read_series(connection: Connection, channel: Channel, window: Window, *, points: int) -> Series:
    """Read a series.

    Args:
        connection: In a read transaction.
        channel: The channel.
        window: The window.
        points: Most samples; beyond, most buckets.
    """
    if is_tiled(channel, window, points):
        hulls = read_hulls(connection, channel, window, points)
        if _count_within(hulls[0], window) > points:
            return _as_hull(channel, *hulls)
    samples = read_few(connection, channel, window, points)
    if samples is not None and len(samples) <= points and _is_exact(samples.first):
        return _as_samples(channel, window, samples)
    return _as_hull(channel, *read_hulls(connection, channel, window, points))


def _count_within(pieces: Aggregates, window: Window) -> int:
    """At least so many samples are in a window."""
    return int(pieces.n[(pieces.first >= window.start) & (pieces.last < window.end)].sum())


def _is_exact(t: NDArray[np.int64]) -> bool:
    return t.size == 0 or int(t[-1]) - int(t[0]) < EXACT // 2


def _as_samples(channel: Channel, window: Window, samples: Aggregates) -> Series:
    t = samples.first
    t0 = int(t[0]) if t.size else window.start
    at = np.flatnonzero(np.diff(t) > longest_step(samples.dt[:-1]))
    return Series(
        node=channel["node"],
        channel=channel["channel"],
        unit=channel["unit"],
        coverage=float(samples.coverage.min(initial=1.0)) if t.size else channel["coverage"],
        resolution="sample",
        t0=t0,
        t=np.insert(t, at + 1, t[at] + samples.dt[at]) - t0,
        lo=np.insert(samples.lo, at + 1, -np.inf),
        hi=np.insert(samples.hi, at + 1, np.inf),
        dt=int(samples.dt.min()) if t.size else max(channel["dt"], 1),
        time_error=int(samples.error.max(initial=0)),
    )


def _as_hull(channel: Channel, pieces: Aggregates, buckets: Buckets) -> Series:
    t = buckets.width * np.arange(buckets.count, dtype=np.int64)
    lo, hi, mean = np.full(t.size, -np.inf), np.full(t.size, np.inf), np.full((2, t.size), np.inf)
    mean[0] = -np.inf
    if len(pieces):
        pieces = pieces.grouped(buckets.of(pieces.first))
        at = buckets.of(pieces.first)
        lo[at], hi[at] = pieces.lo, pieces.hi
        mean[:, at] = _means(pieces)
    least = float(pieces.coverage.min()) if len(pieces) else channel["coverage"]
    return Series(
        node=channel["node"],
        channel=channel["channel"],
        unit=channel["unit"],
        coverage=union_coverage(least, n=int(pieces.n.max(initial=0))),
        resolution="hull",
        t0=buckets.start,
        t=t,
        lo=lo,
        hi=hi,
        mean=(mean[0], mean[1]),
        dt=buckets.width,
        time_error=int(pieces.error.max(initial=0)),
    )


def _means(pieces: Aggregates) -> Floats:
    """An enclosure of the mean of each piece's samples."""
    lo = np.nextafter(pieces.sum_lo / pieces.n, -np.inf)
    hi = np.nextafter(pieces.sum_hi / pieces.n, np.inf)
    return np.stack([np.maximum(lo, pieces.lo), np.minimum(hi, pieces.hi)])
