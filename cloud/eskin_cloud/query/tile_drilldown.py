"""Down the pyramid: which stretches of a window tiles answer, and in which blocks are looked at."""

from __future__ import annotations

from bisect import bisect_right
from typing import TYPE_CHECKING, Final, TypeAlias

import numpy as np

from eskin_cloud.query.predicate import Verdict
from eskin_cloud.rollup.reading import find_open, read_tiles
from eskin_cloud.store.read.window import Window
from eskin_cloud.store.sample_grid import CHUNK, STEP, TOP

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sqlalchemy import Connection, RowMapping

    from eskin_cloud.query.predicate import Predicate
    from eskin_cloud.rollup.aggregates import Aggregates

Part: TypeAlias = "tuple[Aggregates, Verdict] | Window"
_TILES: Final = 64
"""A window is so many tiles of the highest level that is looked at, or somewhat more."""


class TileDrilldown:
    """Asks tiles from the highest down; only those whose bounds leave the answer open are entered.

    Args:
        connection: Reads one state of the store.
        channel: The channel's row.
        window: When.
        question: What is asked of each sample.
        over_gaps: Whether a tile with a gap in it may answer, too.
    """

    def __init__(
        self,
        connection: Connection,
        channel: RowMapping,
        window: Window,
        question: Predicate,
        *,
        over_gaps: bool,
    ) -> None:
        self._connection, self._channel = connection, channel
        self._window, self._question, self._over_gaps = window, question, over_gaps
        self._chunks: dict[int, tuple[int, Aggregates]] = {}
        self._opened: list[tuple[int, int]] = []

    def parts(self) -> Iterator[Part]:
        """Tiles with their answer, and windows in which blocks must be asked, in order of time."""
        window, grain = self._window, self._channel["grain"]
        if grain is None or window.span >> grain < _TILES:
            yield window
            return
        self._opened = find_open(self._connection, self._channel, (window.start, window.end))
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

    def _level(self, level: int, first: int, last: int) -> Iterator[Part]:
        for number in range(first, last + 1):
            yield from self._tile(level, number)

    def _tile(self, level: int, number: int) -> Iterator[Part]:
        first, end = number << level, (number + 1) << level
        window, grain = self._window, self._channel["grain"]
        inside = Window(max(first, window.start), min(end, window.end))
        if inside.span <= 0:
            return
        stretch = self._open_stretch(inside)
        if stretch is not None and stretch[0] <= inside.start and inside.end <= stretch[1]:
            yield inside  # as a whole: below there may be billions of tiles without a sample
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
        whole = self._over_gaps or answer is Verdict.IMPOSSIBLE or piece.breaks[0] == 0
        return answer if whole else None

    def _open_stretch(self, inside: Window) -> tuple[int, int] | None:
        """The last stretch in a window whose blocks must be read in the place of tiles."""
        at = bisect_right(self._opened, (inside.end - 1, self._window.end))
        return self._opened[at - 1] if at and self._opened[at - 1][1] > inside.start else None

    def _find(self, level: int, number: int) -> Aggregates:
        chunk = number >> CHUNK
        if self._chunks.get(level, (None,))[0] != chunk:
            numbers = [(chunk << CHUNK, (chunk + 1) << CHUNK)]
            self._chunks[level] = chunk, read_tiles(self._connection, self._channel, level, numbers)
        pieces = self._chunks[level][1]
        found = np.searchsorted(pieces.first >> level, [number, number + 1])
        return pieces[slice(*found.tolist())]
