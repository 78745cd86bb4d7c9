"""Hulls of frames by patch, at most two a second.

A hull encloses all samples that came since the one before.
"""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from eskin.union_bound import union_coverage
from eskin.wire.frames.column_hulls import ColumnHulls

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from eskin.interval import Floats
    from eskin.wire.frames import DescribedLayout, EncodedFrame, Patch

LARGE: Final = 64
"""Channels from which on a skin's patches are published, and not its channels."""
_PERIOD_S: Final = 0.5
_CHECK_S: Final = 0.1


class PageHull:
    """Encloses the samples of the patches of a page.

    Args:
        skin: By which its frames are read.
        page: Its number.

    Attributes:
        skin: The same.
    """

    def __init__(self, skin: DescribedLayout, page: int) -> None:
        self.skin = skin
        numbers = skin.page_ranges[page]
        self._first = numbers.start
        self._columns = skin.facts[numbers.start : numbers.stop, 0]
        self._ends = np.cumsum(self._columns)
        size = int(self._ends[-1])
        self._lo, self._hi = np.full(size, np.inf), np.full(size, -np.inf)
        self._samples = np.zeros(size, np.int64)
        self._rows: dict[int, Counter[float]] = {}
        self._time: tuple[int, int] | None = None

    def add(self, frame: EncodedFrame) -> None:
        """Enclose the samples of a frame of the page."""
        found = ColumnHulls.of(frame)
        numbers = frame.records["patch"] - self._first
        at: Any = slice(None)
        if len(numbers) < len(self._ends):
            at = np.flatnonzero(
                np.isin(np.repeat(np.arange(len(self._ends)), self._columns), numbers)
            )
        self._lo[at] = np.minimum(self._lo[at], found.lo)
        self._hi[at] = np.maximum(self._hi[at], found.hi)
        self._samples[at] += found.samples
        for number, grid in zip(numbers.tolist(), frame.records["grid"].tolist(), strict=True):
            rows = self._rows.setdefault(number, Counter())
            rows[frame.grids[grid].coverage] += frame.grids[grid].rows
        t0 = frame.time[0] + min(grid.delay for grid in frame.grids)
        t1 = frame.time[1] + max(grid.delay + (grid.rows - 1) * grid.period for grid in frame.grids)
        self._time = (
            (t0, t1) if self._time is None else (min(t0, self._time[0]), max(t1, self._time[1]))
        )

    def patches(self) -> Iterator[PublishedHull]:
        """The hulls of all patches of which there are samples."""
        if self._time is None:
            return
        is_large = self.skin.channels >= LARGE
        for number, rows in self._rows.items():
            patch = self.skin.patches[self._first + number]
            at = slice(self._ends[number] - len(patch.taxels), self._ends[number])
            t0 = self._time[0] + min(patch.skew, default=0)
            t1 = self._time[1] + max(patch.skew, default=0)
            yield PublishedHull(
                is_large, patch, self._lo[at], self._hi[at], self._samples[at], t0, t1, rows
            )


@dataclass(frozen=True, slots=True)
class PublishedHull:
    """Encloses samples of a patch.

    Attributes:
        is_large: Whether its skin has so many channels that it is published as a whole.
        patch: Its description.
        lo: Of each column, the least lower bound; infinite without samples.
        hi: Of each column, the greatest upper bound; minus infinite without samples.
        samples: How many each column has.
        t0: UTC ns, not after the earliest instant of the first sample.
        t1: UTC ns, not before the latest instant of the last.
        rows: How many rows there are, by the coverage of their samples.
    """

    is_large: bool
    patch: Patch
    lo: Floats
    hi: Floats
    samples: NDArray[np.int64]
    t0: int
    t1: int
    rows: Counter[float]

    @property
    def contact(self) -> str | None:
        """Whether something touched the patch at each instant that was sampled.

        None without a threshold. It is certain if some column was above the threshold all the time,
        and impossible if none can have been above it.
        """
        threshold = self.patch.threshold
        if threshold is None:
            return None
        lo, hi = self.bounds
        if bool(np.any(lo > threshold)):
            return "certain"
        return "possible" if bool(np.any(hi > threshold)) else "impossible"

    @property
    def bounds(self) -> tuple[Floats, Floats]:
        """Both bounds of each column; infinite without samples."""
        none = self.samples == 0
        return np.where(none, -np.inf, self.lo), np.where(none, np.inf, self.hi)

    def coverage(self, columns: int = 1) -> float:
        """Probability with which the hulls of so many columns enclose all their samples."""
        parts = (union_coverage(each, n=rows * columns) for each, rows in self.rows.items())
        return union_coverage(*parts)


class HullCollector:
    """Collects the hulls of frames until they are due. Not thread-safe."""

    def __init__(self) -> None:
        self._recent: dict[tuple[str, int], tuple[float, PageHull | None]] = {}
        self._checked = -math.inf

    def add(
        self, node: str, frame: EncodedFrame, skin: DescribedLayout, *, now: float
    ) -> Iterator[tuple[str, PublishedHull]]:
        """Enclose a frame; return what is due, with its node.

        Args:
            node: The node.
            frame: Its frame.
            skin: By which the frame is read.
            now: Monotonic seconds.
        """
        key = node, frame.page
        published, hull = self._recent.get(key, (-math.inf, None))
        if hull is not None and hull.skin is not skin and hull.skin.layout != skin.layout:
            yield from ((node, each) for each in hull.patches())
            hull = None
        hull = hull or PageHull(skin, frame.page)
        hull.add(frame)
        if now >= published + _PERIOD_S:
            yield from ((node, each) for each in hull.patches())
            published, hull = now, None
        self._recent[key] = published, hull

    def run_periodic(self, now: float) -> Iterator[tuple[str, PublishedHull]]:
        """Return what is due of pages of which nothing came since."""
        if now < self._checked + _CHECK_S:
            return
        self._checked = now
        for key, (published, hull) in list(self._recent.items()):
            if now < published + _PERIOD_S:
                continue
            if hull is None:
                del self._recent[key]
            else:
                self._recent[key] = now, None
                yield from ((key[0], each) for each in hull.patches())
