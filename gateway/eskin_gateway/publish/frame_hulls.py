"""Hulls of frames for any MQTT client: of a small skin's channels, of a large skin's patches.

A hull is published at most twice a second. It encloses all samples that came since the one before.
"""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import orjson

from eskin.union_bound import union_coverage
from eskin.wire import senml
from eskin.wire.timestamp import format_timestamp
from eskin.wire.topics import live_topic, senml_topic

if TYPE_CHECKING:
    from collections.abc import Iterator

    from eskin.interval import Floats, Interval
    from eskin.wire.frames import Frame, Patch, PatchSamples
    from eskin_gateway.mqtt.transport import Publication
    from eskin_gateway.spool.descriptions import Skin

LARGE: Final = 64
"""Channels from which on a skin's patches are published, and not its channels."""
_PERIOD_S: Final = 0.5
_CHECK_S: Final = 0.1


@dataclass(slots=True)
class PatchHull:
    """Encloses samples of a patch.

    Attributes:
        patch: Its description.
        is_large: Whether its skin is.
        lo: Of each column, the least lower bound; infinite without samples.
        hi: Of each column, the greatest upper bound; minus infinite without samples.
        samples: How many each column has.
        t0: UTC ns, the earliest moment of the first row.
        t1: UTC ns, the latest moment of the last row.
        rows: How many there are, by the coverage of their samples.
    """

    patch: Patch
    is_large: bool
    lo: Floats = field(init=False)
    hi: Floats = field(init=False)
    samples: Any = field(init=False)
    t0: int = field(init=False)
    t1: int = field(init=False)
    rows: Counter[float] = field(default_factory=Counter)

    def __post_init__(self) -> None:
        columns = len(self.patch.taxels)
        self.lo, self.hi = np.full(columns, np.inf), np.full(columns, -np.inf)
        self.samples = np.zeros(columns, np.int64)

    def add(self, frame: Frame, samples: PatchSamples, values: Interval) -> None:
        """Enclose the samples of a frame."""
        grid = frame.grids[samples.grid]
        lo, hi = values.inf, values.sup
        if samples.strides:
            mask = samples.sampling(grid).mask
            lo, hi = np.where(mask, lo, np.inf), np.where(mask, hi, -np.inf)
            self.samples += mask.sum(axis=0)
        else:
            self.samples += grid.rows
        self.lo = np.minimum(self.lo, lo.min(axis=0))
        self.hi = np.maximum(self.hi, hi.max(axis=0))
        first = grid.delay + min(self.patch.skew, default=0)
        last = grid.delay + (grid.rows - 1) * grid.period + max(self.patch.skew, default=0)
        t0, t1 = frame.time[0] + first, frame.time[1] + last
        self.t0, self.t1 = (min(self.t0, t0), max(self.t1, t1)) if self.rows else (t0, t1)
        self.rows[grid.coverage] += grid.rows

    @property
    def contact(self) -> str | None:
        """Whether something touched the patch at each instant that was sampled.

        None without a threshold. It is certain if some column was above the threshold all the time,
        and impossible if none can have been above it.
        """
        threshold = self.patch.threshold
        if threshold is None:
            return None
        sampled = self.samples > 0
        if bool(np.any(sampled & (self.lo > threshold))):
            return "certain"
        is_unknown = not bool(np.all(sampled))
        return "possible" if is_unknown or bool(np.any(self.hi > threshold)) else "impossible"

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
        self._recent: dict[tuple[str, str], tuple[float, PatchHull | None]] = {}
        self._checked = -math.inf

    def add(self, node: str, frame: Frame, skin: Skin, *, now: float) -> Iterator[Publication]:
        """Enclose a frame, and publish what is due.

        Args:
            node: The node.
            frame: Its frame.
            skin: By which the frame is read.
            now: Monotonic seconds.
        """
        is_large = skin.channels >= LARGE
        for samples, values in zip(frame.patches, frame.values, strict=True):
            patch = skin.patches[samples.patch]
            key = node, patch.patch_id
            published, hull = self._recent.get(key, (-math.inf, None))
            if hull is not None and hull.patch is not patch and hull.patch != patch:
                yield from self._publish(node, hull)
                hull = None
            hull = hull or PatchHull(patch, is_large)
            hull.add(frame, samples, values)
            if now >= published + _PERIOD_S:
                yield from self._publish(node, hull)
                published, hull = now, None
            self._recent[key] = published, hull

    def run_periodic(self, now: float) -> Iterator[Publication]:
        """Publish what is due of patches of which nothing came since."""
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

    def _publish(self, node: str, hull: PatchHull) -> Iterator[Publication]:
        yield from _patch(node, hull) if hull.is_large else _channels(node, hull)
        if self._senml and hull.t0 >= senml.EARLIEST:
            yield from _senml(node, hull)


def _channels(node: str, hull: PatchHull) -> Iterator[Publication]:
    """Topic and JSON of each channel, as of a block."""
    lo, hi = (bounds.tolist() for bounds in hull.bounds())
    common = _common(hull)
    for column, channel in enumerate(hull.patch.channels):
        if hull.samples[column]:
            item = {**common, "lo": lo[column], "hi": hi[column], "n": int(hull.samples[column])}
            yield live_topic(node, channel), orjson.dumps(item), False


def _patch(node: str, hull: PatchHull) -> Iterator[Publication]:
    lo, hi = hull.bounds()
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


def _senml(node: str, hull: PatchHull) -> Iterator[Publication]:
    """As SenML (RFC 8428): of each channel, or of all of a large skin's patch."""
    lo, hi = hull.bounds()
    span = senml.seconds(hull.t1 - hull.t0), senml.SECONDS
    if hull.is_large:
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
