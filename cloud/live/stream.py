"""One stream of server-sent events (HTML standard, section 9.2)."""

from __future__ import annotations

import asyncio
import logging
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from cloud.query.series import Series, reduce_samples, union_coverage
from cloud.query.span import Samples
from cloud.shapes import dump, event_shape, series_shape
from eskin.errors import StoreError
from eskin.messages import Block

if TYPE_CHECKING:
    from collections.abc import AsyncIterator, Callable

    from cloud.live.feed import Feed
    from cloud.store.entry import Entry

log = logging.getLogger(__name__)

_AT_ONCE: Final = 64


@dataclass(frozen=True, slots=True)
class Selection:
    """What a stream is asked for.

    Attributes:
        nodes: These only; all if empty.
        channels: These ``(node, channel)`` only, as far as blocks and peaks go; all if empty.
        points: Entries that a block is reduced to at most.
    """

    nodes: frozenset[str]
    channels: frozenset[tuple[str, str]]
    points: int

    def takes(self, entry: Entry) -> bool:
        """Whether an entry is asked for; what a node says of itself comes with its channels."""
        if self.nodes and entry.node not in self.nodes:
            return False
        if not self.channels:
            return True
        if entry.channel is None:
            return any(node == entry.node for node, _ in self.channels)
        return (entry.node, entry.channel) in self.channels


async def stream(
    feed: Feed,
    selection: Selection,
    *,
    cursor: int,
    backlog: int,
    heartbeat: float,
    allowed: Callable[[], bool],
    reveal: Callable[[Entry], Entry | None],
) -> AsyncIterator[bytes]:
    """Tell what comes after a cursor until the feed closes or access ends.

    Args:
        feed: Where it is read.
        selection: What is told.
        cursor: Where to begin.
        backlog: How far behind a stream may be; beyond, it is told ``lagging`` and moved on.
        heartbeat: Seconds between signs of life.
        allowed: Whether the one who asked still may; asked at every heartbeat.
        reveal: What an entry looks like to the one who asked; ``None`` if it is not shown.
    """
    feed.subscribers += 1
    try:
        yield b"retry: 2000\n: connected\n\n"
        due = time.monotonic() + heartbeat
        while not feed.closed:
            if feed.last - cursor > backlog:
                missed, cursor = cursor, feed.last - backlog
                yield _event("lagging", cursor, {"after": str(missed), "resumed": str(cursor)})
            found, cursor = await feed.after(cursor, _AT_ONCE)
            for entry in found:
                shown = reveal(entry) if selection.takes(entry) else None
                if shown is not None:
                    yield render(shown, selection.points)
            if time.monotonic() >= due:
                if not await asyncio.to_thread(allowed):
                    return
                yield b": heartbeat\n\n"
                due = time.monotonic() + heartbeat
            await feed.wait(cursor, max(0.0, due - time.monotonic()))
    except StoreError as error:  # whoever listens comes back, and then is told
        log.warning("live stream ended: reason=%s", error)
    finally:
        feed.subscribers -= 1


def render(entry: Entry, points: int) -> bytes:
    """An entry as an event of the stream."""
    if entry.block is not None:
        series = reduce_block(entry.node, Block.decode(entry.block), points)
        return _event("block", entry.cursor, series_shape(series))
    row = entry.event or {}
    return _event(str(row["kind"]), entry.cursor, event_shape(row))


def reduce_block(node: str, block: Block, points: int) -> Series:
    """A block as a series of at most ``points`` entries."""
    tube = block.tube
    samples = Samples(
        tube.moments,
        np.full(len(tube), tube.dt, np.int64),
        tube.values.inf,
        tube.values.sup,
    )
    reduced, stride, largest = reduce_samples(samples, points)
    return Series(
        node=node,
        channel=block.channel,
        unit=tube.unit,
        coverage=tube.coverage if stride == 1 else union_coverage(tube.coverage, largest),
        resolution="sample" if stride == 1 else "hull",
        t0=tube.first_moment,
        t=reduced.t - tube.first_moment,
        lo=reduced.lo,
        hi=reduced.hi,
        dt=tube.dt * stride,
        time_error=tube.time_error,
    )


def _event(kind: str, cursor: int, data: object) -> bytes:
    return b"event: %b\nid: %d\ndata: %b\n\n" % (kind.encode(), cursor, dump(data))
