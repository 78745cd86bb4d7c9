"""Blocks of one channel in a window: which they are, and their samples in order of time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
from sqlalchemy import and_, func, select

from cloud.store.schema import blocks
from eskin.messages import Block

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from numpy.typing import NDArray
    from sqlalchemy import ColumnElement, Connection, RowMapping

    from cloud.query.window import Window
    from eskin.interval import Floats

_AT_ONCE: Final = 256


@dataclass(frozen=True, slots=True)
class Samples:
    """Samples in order of time.

    Attributes:
        t: Middle of each moment, UTC ns.
        dt: Sampling period in ns, for each sample.
        lo: Lower bounds.
        hi: Upper bounds.
    """

    t: NDArray[np.int64]
    dt: NDArray[np.int64]
    lo: Floats
    hi: Floats

    @property
    def breaks(self) -> NDArray[np.bool_]:
        """Whether a gap lies between each sample and the next, shape ``(n - 1,)``."""
        return np.asarray(np.diff(self.t) > longest_step(self.dt[:-1]))


@dataclass(frozen=True, slots=True)
class Summary:
    """What blocks in a window have in common.

    Attributes:
        samples: How many samples lie in the window.
        coverage: The least coverage.
        error: The greatest time error, in ns.
        dt: The smallest sampling period, in ns.
    """

    samples: int
    coverage: float
    error: int
    dt: int


def longest_step(dt: NDArray[np.int64]) -> NDArray[np.int64]:
    """The longest time to the next sample that is no gap: half a period late at most."""
    return dt + dt // 2


def touching(channel: RowMapping, window: Window) -> ColumnElement[bool]:
    """Whether a block of the channel reaches into the window."""
    earliest = max(window.start - channel["longest"], -(2**63) + 1)
    return and_(
        blocks.c.node == channel["node"],
        blocks.c.channel == channel["channel"],
        blocks.c.t >= earliest,
        blocks.c.t < window.end,
        blocks.c.t_end >= window.start,
    )


def inside(window: Window) -> ColumnElement[bool]:
    """Whether a block lies wholly in the window."""
    return and_(blocks.c.t >= window.start, blocks.c.t_end < window.end)


def summarise(connection: Connection, channel: RowMapping, window: Window) -> Summary:
    """Count a window's samples without touching one."""
    here = touching(channel, window)
    b = blocks.c
    sums = select(func.sum(b.n), func.min(b.coverage), func.max(b.error), func.min(b.dt))
    n, coverage, error, dt = connection.execute(sums.where(here, inside(window))).one()
    found = [Summary(int(n), coverage, error, dt)] if n else []
    edges = select(b.t, b.n, b.coverage, b.error, b.dt).where(here, ~inside(window))
    for t, n, coverage, error, dt in connection.execute(edges):
        first, last = clip(t, dt, n, window)
        if first <= last:
            found.append(Summary(last - first + 1, coverage, error, dt))
    if not found:
        return Summary(0, channel["coverage"], 0, channel["dt"])
    return Summary(
        sum(part.samples for part in found),
        min(part.coverage for part in found),
        max(part.error for part in found),
        min(part.dt for part in found),
    )


def clip(t: int, dt: int, n: int, window: Window) -> tuple[int, int]:
    """The first and the last index of a block's samples in a window; reversed if there is none."""
    return max(0, -((t - window.start) // dt)), min(n - 1, (window.end - 1 - t) // dt)


def read_blocks(connection: Connection, where: ColumnElement[bool]) -> Iterator[list[Block]]:
    """Decode blocks, a limited number at a time, in order of time."""
    query = select(blocks.c.data).where(where)
    query = query.order_by(blocks.c.t, blocks.c.boot, blocks.c.sequence)
    for part in connection.execute(query).scalars().partitions(_AT_ONCE):
        yield [Block.decode(data) for data in part]


def gather(found: Iterable[Block], window: Window) -> Samples:
    """The samples of blocks that lie in a window."""
    tubes = [block.tube for block in found]
    if not tubes:
        none = np.empty(0, np.int64)
        return Samples(none, none, np.empty(0), np.empty(0))
    t = np.concatenate([tube.moments for tube in tubes])
    dt = np.concatenate([np.full(len(tube), tube.dt, np.int64) for tube in tubes])
    lo = np.concatenate([tube.values.inf for tube in tubes])
    hi = np.concatenate([tube.values.sup for tube in tubes])
    within = (t >= window.start) & (t < window.end)
    order = np.flatnonzero(within)
    if np.any(np.diff(t[order]) < 0):
        order = order[np.argsort(t[order], kind="stable")]
    return Samples(t[order], dt[order], lo[order], hi[order])
