"""Blocks of one channel in a window: which they are, and how many samples of theirs lie in it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from sqlalchemy import and_, bindparam, func, not_, select

from eskin_cloud.store.schema.tables import blocks

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray
    from sqlalchemy import ColumnElement, Connection, RowMapping

    from eskin.interval import Floats
    from eskin_cloud.store.read.window import Window


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


def longest_step(dt: NDArray[np.int64]) -> NDArray[np.int64]:
    """The longest time to the next sample that is no gap: half a period late at most."""
    return dt + dt // 2


def before(moment: int, span: int) -> int:
    """A moment and so much before it, UTC ns, down to the first that a store can hold."""
    return max(moment - span, -(2**63))


TOUCHING: Final = and_(
    blocks.c.node == bindparam("node"),
    blocks.c.channel == bindparam("channel"),
    blocks.c.t >= bindparam("earliest"),
    blocks.c.t < bindparam("end"),
    blocks.c.t_end >= bindparam("start"),
)
"""Whether a block of a channel reaches into a window, for statements that are made once."""
_FIRST: Final = (
    select(blocks.c.t, blocks.c.dt, blocks.c.n)
    .where(TOUCHING)
    .order_by(blocks.c.t)
    .limit(bindparam("most"))
)


def near(channel: RowMapping, window: Window) -> dict[str, str | int]:
    """What `TOUCHING` is told of a channel and a window."""
    return {
        "node": channel["node"],
        "channel": channel["channel"],
        "earliest": before(window.start, channel["longest"]),
        "end": window.end,
        "start": window.start,
    }


def touching(channel: RowMapping, window: Window) -> ColumnElement[bool]:
    """The same for a statement that is made for one question."""
    said = near(channel, window)
    return and_(
        blocks.c.node == said["node"],
        blocks.c.channel == said["channel"],
        blocks.c.t >= said["earliest"],
        blocks.c.t < said["end"],
        blocks.c.t_end >= said["start"],
    )


def find_next(connection: Connection, channel: RowMapping, window: Window) -> int | None:
    """The earliest moment at which the first sample behind a window may have been taken, or before.

    Behind is what is told so: its true moment may lie in the window. ``None`` if there is none.
    """
    b, end = blocks.c, window.end
    here = and_(b.node == channel["node"], b.channel == channel["channel"])
    earliest = before(end, channel["longest"])
    over = select(func.max(b.error)).where(here, b.t >= earliest, b.t < end, b.t_end >= end)
    reaching: int | None = connection.execute(over).scalar_one()
    begun = select(b.t, b.error).where(here, b.t >= end).order_by(b.t, b.error.desc()).limit(1)
    found = [t - error for t, error in connection.execute(begun)]
    return min(found if reaching is None else [end - reaching, *found], default=None)


def clip(t: int, dt: int, n: int, window: Window) -> tuple[int, int]:
    """The first and the last index of a block's samples in a window; reversed if there is none."""
    return max(0, -((t - window.start) // dt)), min(n - 1, (window.end - 1 - t) // dt)


def count(connection: Connection, channel: RowMapping, window: Window) -> int:
    """How many samples lie in a window; only blocks at its edges are looked at one by one."""
    b = blocks.c
    inside = and_(b.t >= window.start, b.t_end < window.end)
    here = touching(channel, window)
    whole: int = connection.execute(
        select(func.coalesce(func.sum(b.n), 0)).where(here, inside)
    ).scalar_one()
    edges = connection.execute(select(b.t, b.dt, b.n).where(here, not_(inside)))
    clipped = (clip(t, dt, n, window) for t, dt, n in edges)
    return int(whole) + sum(max(0, last - first + 1) for first, last in clipped)


def exceeds(connection: Connection, channel: RowMapping, window: Window, most: int) -> bool:
    """Whether more than so many samples lie in a window, from a look at as many blocks at most."""
    said = near(channel, window) | {"most": most + 1}
    samples = 0
    for t, dt, n in connection.execute(_FIRST, said):
        first, last = clip(t, dt, n, window)
        samples += max(0, last - first + 1)
        if samples > most:
            return True
    return False
