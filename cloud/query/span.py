"""Blocks of one channel in a window: which they are, and how many samples of theirs lie in it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from sqlalchemy import and_, func, not_, select

from cloud.store.schema import blocks

if TYPE_CHECKING:
    from numpy.typing import NDArray
    from sqlalchemy import ColumnElement, Connection, RowMapping

    from cloud.query.window import Window
    from eskin.interval import Floats


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


def clip(t: int, dt: int, n: int, window: Window) -> tuple[int, int]:
    """The first and the last index of a block's samples in a window; reversed if there is none."""
    return max(0, -((t - window.start) // dt)), min(n - 1, (window.end - 1 - t) // dt)


def count(connection: Connection, channel: RowMapping, window: Window) -> int:
    """How many samples lie in a window; only blocks at its edges are looked at one by one."""
    b = blocks.c
    inside = and_(b.t >= window.start, b.t_end < window.end)
    near = touching(channel, window)
    whole: int = connection.execute(
        select(func.coalesce(func.sum(b.n), 0)).where(near, inside)
    ).scalar_one()
    edges = connection.execute(select(b.t, b.dt, b.n).where(near, not_(inside)))
    clipped = (clip(t, dt, n, window) for t, dt, n in edges)
    return int(whole) + sum(max(0, last - first + 1) for first, last in clipped)


def exceeds(connection: Connection, channel: RowMapping, window: Window, most: int) -> bool:
    """Whether more than so many samples lie in a window, from a look at as many blocks at most."""
    b = blocks.c
    query = select(b.t, b.dt, b.n).where(touching(channel, window)).order_by(b.t)
    samples = 0
    for t, dt, n in connection.execute(query.limit(most + 1)):
        first, last = clip(t, dt, n, window)
        samples += max(0, last - first + 1)
        if samples > most:
            return True
    return False
