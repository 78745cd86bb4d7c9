"""Decide a predicate by tiles, from the highest level down, and find where to read samples."""

from __future__ import annotations

from bisect import bisect_right
from typing import TYPE_CHECKING, Final, TypeAlias

import numpy as np

from eskin.interval import Verdict
from eskin_cloud.rollup.patch_tiles import find_unbuilt, read_tiles
from eskin_cloud.store.read.window import Window
from eskin_cloud.store.sample_grid import PATCH_CHUNK, STEP, TOP

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sqlalchemy import Connection

    from eskin_cloud.query.predicate import Predicate
    from eskin_cloud.rollup.aggregates import Aggregates
    from eskin_cloud.store.read.lookup import Channel

TileAnswer: TypeAlias = "tuple[Aggregates, Verdict] | Window"
_TILES: Final = 64
"""Least tiles of the highest level that is read."""


class TileDrilldown:
    """Reads tiles from the highest level down; undecided tiles are resolved by lower levels.

    Args:
        connection: In a read transaction.
        channel: The channel.
        window: The window.
        question: The predicate.
    """

    def __init__(
        self,
        connection: Connection,
        channel: Channel,
        window: Window,
        question: Predicate,
    ) -> None:
        self._connection, self._channel = connection, channel
        self._window, self._question = window, question
        self._chunks: dict[int, tuple[int, Aggregates]] = {}
        self._opened: list[tuple[int, int]] = []

    def parts(self) -> Iterator[TileAnswer]:
        """Decided tiles, and windows in which samples must be read, in order of time."""
        window, grain = self._window, self._channel["grain"]
        if grain is None or window.span >> grain < _TILES:
            yield window
            return
        self._opened = find_unbuilt(self._connection, self._channel, (window.start, window.end))
        level = grain
        while level + STEP <= TOP and window.span >> (level + STEP) >= _TILES:
            level += STEP
        waiting: Window | None = None
        for part in self._level(level, window.start >> level, (window.end - 1) >> level):
            if isinstance(part, Window) and waiting is not None and waiting.end == part.start:
                waiting = Window(waiting.start, part.end)
                continue
            if waiting is not None:
                yield waiting
            waiting = part if isinstance(part, Window) else None
            if waiting is None:
                yield part
        if waiting is not None:
            yield waiting

    def _level(self, level: int, first: int, last: int) -> Iterator[TileAnswer]:
        for number in range(first, last + 1):
            yield from self._tile(level, number)

    def _tile(self, level: int, number: int) -> Iterator[TileAnswer]:
        first, end = number << level, (number + 1) << level
        window, grain = self._window, self._channel["grain"]
        inside = Window(max(first, window.start), min(end, window.end))
        if inside.span <= 0:
            return
        stretch = self._open_stretch(inside)
        if stretch is not None and stretch[0] <= inside.start and inside.end <= stretch[1]:
            yield inside  # at once: lower levels may have billions of empty tiles
            return
        if stretch is None:
            piece = self._find(level, number)
            if len(piece) == 0:
                return
            answer = self._answer(piece) if inside == Window(first, end) else None
            if answer is not None:
                yield piece, answer
                return
        if level == grain:
            yield inside
            return
        yield from self._level(level - STEP, number << STEP, (number << STEP) + (1 << STEP) - 1)

    def _answer(self, piece: Aggregates) -> Verdict | None:
        answer = self._question.answer(piece.lo[0], piece.hi[0])
        whole = answer is Verdict.IMPOSSIBLE or piece.breaks[0] == 0
        return answer if whole else None

    def _open_stretch(self, inside: Window) -> tuple[int, int] | None:
        """The last range in a window in which samples must be read instead of tiles."""
        at = bisect_right(self._opened, (inside.end - 1, self._window.end))
        return self._opened[at - 1] if at and self._opened[at - 1][1] > inside.start else None

    def _find(self, level: int, number: int) -> Aggregates:
        chunk = number >> PATCH_CHUNK
        if self._chunks.get(level, (None,))[0] != chunk:
            numbers = [(chunk << PATCH_CHUNK, (chunk + 1) << PATCH_CHUNK)]
            self._chunks[level] = chunk, read_tiles(self._connection, self._channel, level, numbers)
        pieces = self._chunks[level][1]
        found = np.searchsorted(pieces.first >> level, [number, number + 1])
        return pieces[slice(*found.tolist())]
