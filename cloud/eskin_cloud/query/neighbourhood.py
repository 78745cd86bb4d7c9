"""Read the samples of a channel that may be valid in a window."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from eskin.wire.timestamp import MOST_MOMENT
from eskin_cloud.rollup.aggregates import EMPTY
from eskin_cloud.rollup.samples import read_samples
from eskin_cloud.store.read.patch_columns import next_rows, previous_rows
from eskin_cloud.store.read.window import Window

if TYPE_CHECKING:
    from sqlalchemy import Connection

    from eskin_cloud.rollup.aggregates import Aggregates
    from eskin_cloud.store.read.lookup import Channel


NEAR: Final = 64
"""Samples beside a window that are read at first."""
GROWTH: Final = 8
"""How many times as many are read next."""


class ChannelSource(NamedTuple):
    """A channel, and the read transaction that holds it."""

    connection: Connection
    channel: Channel


def read_around(source: ChannelSource, window: Window) -> Aggregates:
    """The samples in and around a window, so far that no other may be valid in it.

    What is read grows on both sides until samples beside it are known to hold before the window,
    and after it. It reaches over a gap, however long, to the next rows and no further.
    """
    channel = source.channel
    if channel["t_first"] is None:
        return EMPTY
    margin = NEAR * max(channel["dt"], 1)
    wide = Window(max(window.start - margin, -MOST_MOMENT), min(window.end + margin, MOST_MOMENT))
    while True:
        samples = read_samples(source.connection, channel, wide)
        earliest = samples.first - samples.error
        sure = earliest[samples.first + samples.error <= window.start]
        after = wide.end > channel["t_last"] or bool(np.any(earliest >= window.end))
        before = wide.start <= channel["t_first"] or bool(
            sure.size and samples.first[0] <= sure.max()
        )
        if after and before:
            return samples
        wide = Window(
            wide.start if before else earlier(source, wide.start, margin),
            wide.end if after else later(source, wide.end, margin),
        )
        margin *= GROWTH


def earlier(source: ChannelSource, start: int, margin: int) -> int:
    """Since when to read, for more samples before a time, and so many ns at least."""
    rows = previous_rows(source.connection, source.channel, start)
    found = source.channel["t_first"] if rows is None else min(rows, start - margin)
    return int(max(found, -MOST_MOMENT))


def later(source: ChannelSource, end: int, margin: int) -> int:
    """Until when to read, for more samples from a time on, and so many ns at least."""
    rows = next_rows(source.connection, source.channel, end)
    found = source.channel["t_last"] if rows is None else max(rows, end + margin)
    return int(min(found + 1, MOST_MOMENT))
