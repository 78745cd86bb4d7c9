"""Find and count the blocks of a channel in a window."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

from sqlalchemy import and_, bindparam, func, not_, select

from eskin_cloud.store.damage import RowHeader, intact_headers
from eskin_cloud.store.read.patch_columns import count_column, find_next_sample, is_column
from eskin_cloud.store.read.window import before, clip
from eskin_cloud.store.schema.tables import blocks

if TYPE_CHECKING:
    from collections.abc import Iterator

    import numpy as np
    from numpy.typing import NDArray
    from sqlalchemy import ColumnElement, Connection, RowMapping, Select

    from eskin.interval import Floats
    from eskin_cloud.store.read.lookup import Channel
    from eskin_cloud.store.read.window import Window

_FOLLOWING: Final = 8
"""Blocks after a window that are read, as the first ones may be damaged."""


@dataclass(frozen=True, slots=True)
class Samples:
    """Samples in order of time.

    Attributes:
        t: Middle of each sample's time, UTC ns.
        dt: Sampling period in ns, for each sample.
        lo: Lower bounds.
        hi: Upper bounds.
    """

    t: NDArray[np.int64]
    dt: NDArray[np.int64]
    lo: Floats
    hi: Floats


def longest_step(dt: NDArray[np.int64]) -> NDArray[np.int64]:
    """The longest step to the next sample without a gap: 1.5 periods."""
    return dt + dt // 2


HEADER_COLUMNS: Final = tuple(blocks.c[name] for name in (*RowHeader._fields, "head"))
"""What `intact_headers` reads of a block.

Values that an answer states are read from rows, which have digests. The index ``blocks_by_time``,
which has none, only finds and counts them.
"""
OVERLAPS: Final = and_(
    blocks.c.node == bindparam("node"),
    blocks.c.channel == bindparam("channel"),
    blocks.c.t >= bindparam("earliest"),
    blocks.c.t < bindparam("end"),
    blocks.c.t_end >= bindparam("start"),
)
"""Whether a block overlaps a window, for prepared statements."""
_FIRST: Final = (
    select(blocks.c.t, blocks.c.dt, blocks.c.n)
    .where(OVERLAPS)
    .order_by(blocks.c.t)
    .limit(bindparam("most"))
)


def window_parameters(channel: Channel, window: Window) -> dict[str, str | int]:
    """Parameters of `OVERLAPS`."""
    return {
        "node": channel["node"],
        "channel": channel["channel"],
        "earliest": before(window.start, channel["longest"]),
        "end": window.end,
        "start": window.start,
    }


def overlaps(channel: Channel, window: Window) -> ColumnElement[bool]:
    """Whether a block overlaps a window, for a statement of one query."""
    parameters = window_parameters(channel, window)
    return and_(
        blocks.c.node == parameters["node"],
        blocks.c.channel == parameters["channel"],
        blocks.c.t >= parameters["earliest"],
        blocks.c.t < parameters["end"],
        blocks.c.t_end >= parameters["start"],
    )


def find_next(connection: Connection, channel: Channel, window: Window) -> int | None:
    """A lower bound of the true time of the first sample after a window.

    A sample is after the window by its stated time; its true time may lie inside. ``None`` if there
    is no such sample.
    """
    if is_column(channel):
        return find_next_sample(connection, channel, window.end)
    b, end = blocks.c, window.end
    here = select(*HEADER_COLUMNS).where(b.node == channel["node"], b.channel == channel["channel"])
    earliest = before(end, channel["longest"])
    over = here.where(b.t >= earliest, b.t < end, b.t_end >= end)
    reaching = [row["error"] for row in _intact(connection, over)]
    begun = here.where(b.t >= end).order_by(b.t, b.error.desc()).limit(_FOLLOWING)
    following = next(_intact(connection, begun), None)
    found = [] if following is None else [following["t"] - following["error"]]
    return min([end - max(reaching), *found] if reaching else found, default=None)


def _intact(connection: Connection, query: Select[Any]) -> Iterator[RowMapping]:
    return intact_headers(connection.execute(query).mappings())


def count_samples(connection: Connection, channel: Channel, window: Window) -> int:
    """The number of samples in a window; only blocks at its edges are read one by one."""
    if is_column(channel):
        return count_column(connection, channel, window)
    b = blocks.c
    inside = and_(b.t >= window.start, b.t_end < window.end)
    here = overlaps(channel, window)
    whole: int = connection.execute(
        select(func.coalesce(func.sum(b.n), 0)).where(here, inside)
    ).scalar_one()
    edges = connection.execute(select(b.t, b.dt, b.n).where(here, not_(inside)))
    clipped = (clip(t, dt, n, window) for t, dt, n in edges)
    return int(whole) + sum(max(0, last - first + 1) for first, last in clipped)


def exceeds(connection: Connection, channel: Channel, window: Window, most: int) -> bool:
    """Whether a window holds more than ``most`` samples; reads at most ``most + 1`` blocks."""
    parameters = window_parameters(channel, window) | {"most": most + 1}
    samples = 0
    for t, dt, n in connection.execute(_FIRST, parameters):
        first, last = clip(t, dt, n, window)
        samples += max(0, last - first + 1)
        if samples > most:
            return True
    return False
