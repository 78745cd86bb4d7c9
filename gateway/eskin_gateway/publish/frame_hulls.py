"""Hulls of frames for any MQTT client: of a small skin's channels, of a large skin's patches.

A hull is published at most twice a second. It encloses all samples that came since the one before.
"""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import orjson

from eskin.union_bound import union_coverage
from eskin.wire import senml
from eskin.wire.frames.column_hulls import ColumnHulls
from eskin.wire.timestamp import format_timestamp
from eskin.wire.topics import live_topic, senml_topic

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from eskin.interval import Floats
    from eskin.wire.frames import FrameSummary, Patch
    from eskin_gateway.mqtt.transport import Publication
    from eskin_gateway.spool.descriptions import Skin

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

    def __init__(self, skin: Skin, page: int) -> None:
        self.skin = skin
        self._first = skin.ends[page] - skin.layout.pages[page]
        self._columns = skin.columns[self._first : skin.ends[page]]
        self._ends = np.cumsum(self._columns)
        size = int(self._ends[-1])
        self._lo, self._hi = np.full(size, np.inf), np.full(size, -np.inf)
        self._samples = np.zeros(size, np.int64)
        self._rows: dict[int, Counter[float]] = {}
        self._time: tuple[int, int] | None = None

    def add(self, frame: FrameSummary, data: bytes) -> None:
        """Enclose the samples of a frame of the page."""
        found = ColumnHulls.of(data, frame)
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

    def patches(self) -> Iterator[PatchHull]:
        """The hulls of all patches of which there are samples."""
        if self._time is None:
            return
        for number, rows in self._rows.items():
            patch = self.skin.patches[self._first + number]
            at = slice(self._ends[number] - len(patch.taxels), self._ends[number])
            t0 = self._time[0] + min(patch.skew, default=0)
            t1 = self._time[1] + max(patch.skew, default=0)
            yield PatchHull(patch, self._lo[at], self._hi[at], self._samples[at], t0, t1, rows)


@dataclass(frozen=True, slots=True)
class PatchHull:
    """Encloses samples of a patch.

    Attributes:
        patch: Its description.
        lo: Of each column, the least lower bound; infinite without samples.
        hi: Of each column, the greatest upper bound; minus infinite without samples.
        samples: How many each column has.
        t0: UTC ns, not after the earliest moment of the first sample.
        t1: UTC ns, not before the latest moment of the last.
        rows: How many rows there are, by the coverage of their samples.
    """

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


class FrameHulls:
    """Publishes the hulls of frames. Not thread-safe.

    Args:
        senml: Whether hulls are published as SenML, too.
    """

    def __init__(self, *, senml: bool) -> None:
        self._senml = senml
        self._recent: dict[tuple[str, int], tuple[float, PageHull | None]] = {}
        self._checked = -math.inf

    def add(
        self, node: str, frame: FrameSummary, data: bytes, skin: Skin, *, now: float
    ) -> Iterator[Publication]:
        """Enclose a frame, and publish what is due.

        Args:
            node: The node.
            frame: Its frame.
            data: The same as bytes.
            skin: By which the frame is read.
            now: Monotonic seconds.
        """
        key = node, frame.page
        published, hull = self._recent.get(key, (-math.inf, None))
        if hull is not None and hull.skin is not skin and hull.skin.layout != skin.layout:
            yield from self._publish(node, hull)
            hull = None
        hull = hull or PageHull(skin, frame.page)
        hull.add(frame, data)
        if now >= published + _PERIOD_S:
            yield from self._publish(node, hull)
            published, hull = now, None
        self._recent[key] = published, hull

    def run_periodic(self, now: float) -> Iterator[Publication]:
        """Publish what is due of pages of which nothing came since."""
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
                yield from self._publish(key[0], hull)

    def _publish(self, node: str, page: PageHull) -> Iterator[Publication]:
        is_large = page.skin.channels >= LARGE
        for hull in page.patches():
            yield from _patch(node, hull) if is_large else _channels(node, hull)
            if self._senml and hull.t0 >= senml.EARLIEST:
                yield from _senml(node, hull, is_large=is_large)


def _channels(node: str, hull: PatchHull) -> Iterator[Publication]:
    """Topic and JSON of each channel, as of a block."""
    lo, hi = (bounds.tolist() for bounds in hull.bounds)
    common = _common(hull)
    for column, channel in enumerate(hull.patch.channels):
        if hull.samples[column]:
            item = {**common, "lo": lo[column], "hi": hi[column], "n": int(hull.samples[column])}
            yield live_topic(node, channel), orjson.dumps(item), False


def _patch(node: str, hull: PatchHull) -> Iterator[Publication]:
    lo, hi = hull.bounds
    item = {
        **_common(hull),
        "n": int(hull.samples.max()),
        "taxels": hull.patch.taxels,
        "lo": lo.tolist(),  # orjson writes infinities as null
        "hi": hi.tolist(),
        "hull": {
            "lo": float(lo.min()),
            "hi": float(hi.max()),
            "coverage": hull.coverage(len(lo)),
        },
        "contact": hull.contact,
    }
    yield live_topic(node, f"patches/{hull.patch.patch_id}"), orjson.dumps(item), False


def _common(hull: PatchHull) -> dict[str, Any]:
    return {
        "t0": format_timestamp(hull.t0),
        "t1": format_timestamp(hull.t1),
        "unit": hull.patch.unit,
        "coverage": hull.coverage(),
    }


def _senml(node: str, hull: PatchHull, *, is_large: bool) -> Iterator[Publication]:
    """As SenML (RFC 8428): of each channel, or of all of a large skin's patch."""
    lo, hi = hull.bounds
    span = senml.seconds(hull.t1 - hull.t0), senml.SECONDS
    if is_large:
        leaf = f"patches/{hull.patch.patch_id}"
        about = {"coverage": (hull.coverage(len(lo)), senml.RATIO), "span": span}
        if hull.contact is not None:
            about["contact/lo"] = float(hull.contact == "certain"), senml.RATIO
            about["contact/hi"] = float(hull.contact != "impossible"), senml.RATIO
        parts = [(leaf, float(lo.min()), float(hi.max()))]
    else:
        about = {"coverage": (hull.coverage(), senml.RATIO), "span": span}
        sampled = np.flatnonzero(hull.samples).tolist()
        channels = hull.patch.channels
        parts = [(channels[k], float(lo[k]), float(hi[k])) for k in sampled]
    for leaf, low, high in parts:
        pack = senml.Pack(f"{node}/{leaf}/", hull.patch.unit, hull.t0, (0,), (low,), (high,), about)
        yield senml_topic(node, leaf), senml.as_json(pack), False
