"""Read a channel around a window: blocks' bounds, and samples on demand."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
from sqlalchemy import select, tuple_

from eskin.wire.timestamp import MOST_MOMENT
from eskin_cloud.query.sample_validity import SampleValidity
from eskin_cloud.rollup.aggregates import EMPTY, Aggregates, concatenated
from eskin_cloud.rollup.blocks import DECODED, decode, of_headers, read_samples
from eskin_cloud.store.damage import intact_headers
from eskin_cloud.store.read.block_index import HEADER_COLUMNS, overlaps
from eskin_cloud.store.read.patch_columns import is_column
from eskin_cloud.store.read.window import Window
from eskin_cloud.store.schema.tables import blocks

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray
    from sqlalchemy import Connection, RowMapping

    from eskin_cloud.rollup.aggregates import Integers
    from eskin_cloud.store.read.lookup import Channel

_ALWAYS: Final = Window(-MOST_MOMENT, MOST_MOMENT)


@dataclass(frozen=True, slots=True)
class ChannelSource:
    """A channel's row, and the read transaction that holds it."""

    connection: Connection
    channel: Channel


class Neighbourhood:
    """The possible values of a channel in a window, refined by `look`.

    Args:
        source: The channel.
        window: The window.
    """

    def __init__(self, source: ChannelSource, window: Window) -> None:
        self._source = source
        self._rows = _read_around(source, window)
        self._looked: dict[int, Aggregates] = {}
        self._bounds = of_headers(self._rows)
        overlapping = np.zeros(len(self._rows), np.bool_)
        if self._rows:
            reached = np.maximum.accumulate(self._bounds.last)
            together = self._bounds.first[1:] <= reached[:-1]
            overlapping[1:] |= together
            overlapping[:-1] |= together
        self._look(np.flatnonzero(overlapping))

    @property
    def holding(self) -> SampleValidity:
        """The validity of each entry."""
        return SampleValidity.of(self._pieces())

    def look(self, chosen: NDArray[np.bool_]) -> None:
        """Decode the blocks of some entries.

        Args:
            chosen: Which entries of `holding`.
        """
        begun = np.unique(self._pieces().first[chosen])
        self._look(np.flatnonzero(np.isin(self._bounds.first, begun)))

    def _pieces(self) -> Aggregates:
        whole = np.ones(len(self._rows), np.bool_)
        whole[list(self._looked)] = False
        samples = [self._looked[number] for number in sorted(self._looked)]
        return concatenated([self._bounds[whole], *samples])

    def _look(self, numbers: Integers) -> None:
        rows = {number: self._rows[number] for number in numbers.tolist()}
        rows = {number: row for number, row in rows.items() if number not in self._looked}
        if not rows:
            return
        b = blocks.c
        node = self._source.channel["node"]
        keys = [(node, row["boot"], row["sequence"]) for row in rows.values()]
        query = select(b.boot, b.sequence, *DECODED)
        query = query.where(tuple_(b.node, b.boot, b.sequence).in_(keys))
        found = {(row[0], row[1]): row[2:] for row in self._source.connection.execute(query)}
        for number, row in rows.items():
            self._looked[number] = decode([found[row["boot"], row["sequence"]]], _ALWAYS)


class SampledNeighbourhood:
    """As `Neighbourhood`, of a channel of frames: its samples.

    Args:
        source: The channel.
        window: The window.
    """

    def __init__(self, source: ChannelSource, window: Window) -> None:
        self._samples = _read_samples_around(source, window)

    @property
    def holding(self) -> SampleValidity:
        """The validity of each sample."""
        return SampleValidity.of(self._samples)

    def look(self, chosen: NDArray[np.bool_]) -> None:
        """Nothing is left to decode."""


def look_around(source: ChannelSource, window: Window) -> Neighbourhood | SampledNeighbourhood:
    """What may be valid of a channel in a window."""
    made = SampledNeighbourhood if is_column(source.channel) else Neighbourhood
    return made(source, window)


def _read_samples_around(source: ChannelSource, window: Window) -> Aggregates:
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


def _read_around(source: ChannelSource, window: Window) -> Sequence[RowMapping]:
    """The blocks in and around a window, so far that no other may be valid in it."""
    channel = source.channel
    if channel["t_first"] is None:
        return []
    margin = 2 * max(channel["longest"], channel["dt"])
    b = blocks.c
    while True:
        wide = _widened(window, margin)
        query = (
            select(*HEADER_COLUMNS).where(overlaps(channel, wide)).order_by(b.t, b.boot, b.sequence)
        )
        rows = list(intact_headers(source.connection.execute(query).mappings()))
        if _is_enough(rows, window, wide, channel):
            return rows
        margin *= 4


def _is_enough(rows: Sequence[RowMapping], window: Window, wide: Window, channel: Channel) -> bool:
    after = wide.end > channel["t_last"] or any(r["t"] - r["error"] >= window.end for r in rows)
    sure = [r["t"] - r["error"] for r in rows if r["t"] + r["error"] <= window.start]
    before = wide.start <= channel["t_first"] or (bool(sure) and rows[0]["t"] <= max(sure))
    return after and before
