"""Read the samples of a channel that may be valid in a window."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from eskin.wire.timestamp import MOST_MOMENT
from eskin_cloud.query.sample_validity import SampleValidity
from eskin_cloud.rollup.aggregates import EMPTY
from eskin_cloud.rollup.samples import read_samples
from eskin_cloud.store.read.window import Window

if TYPE_CHECKING:
    from sqlalchemy import Connection

    from eskin_cloud.rollup.aggregates import Aggregates
    from eskin_cloud.store.read.lookup import Channel


class ChannelSource(NamedTuple):
    """A channel, and the read transaction that holds it."""

    connection: Connection
    channel: Channel


def look_around(source: ChannelSource, window: Window) -> SampleValidity:
    """When each sample in and around a window may be valid."""
    return SampleValidity.of(read_around(source, window))


def read_around(source: ChannelSource, window: Window) -> Aggregates:
    """The samples in and around a window, so far that no other may be valid in it."""
    channel = source.channel
    if channel["t_first"] is None:
        return EMPTY
    margin = 2 * max(channel["longest"], channel["dt"])
    while True:
        wide = _widened(window, margin)
        samples = read_samples(source.connection, channel, wide)
        earliest = samples.first - samples.error
        sure = earliest[samples.first + samples.error <= window.start]
        after = wide.end > channel["t_last"] or bool(np.any(earliest >= window.end))
        before = wide.start <= channel["t_first"] or bool(
            sure.size and samples.first[0] <= sure.max()
        )
        if after and before:
            return samples
        margin *= 4


def _widened(window: Window, margin: int) -> Window:
    return Window(max(window.start - margin, -MOST_MOMENT), min(window.end + margin, MOST_MOMENT))
