"""The firmware's state of a taxel, in columns of nodes, and in a single node."""

from __future__ import annotations

from math import inf
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from eskin.peaks.certain_possible_peaks import PROGRESS
from eskin.peaks.hysteresis import NONE, PASS
from eskin.peaks.region import MOST_REGIONS, REGION
from eskin_sensor_node.firmware.peaks import Hysteresis, PeakDetector, Span

if TYPE_CHECKING:
    from collections.abc import Sequence

    from eskin_sensor_node.firmware.channel import ChannelUnit

REST: Final = np.dtype(
    [
        *((name, np.float64) for name in ("lo", "hi", "past_lo", "past_hi")),
        *((name, np.int64) for name in ("known", "calibrating", "silent", "fresh", "since")),
    ]
)
"""A channel's rest, what smoothing remembers, since which sample, and frames it was not sent."""
_NOWHERE: Final = (NONE, 0, inf, -inf, inf, -inf, -inf)


class Columns(NamedTuple):
    """Each an array of channels × nodes.

    Attributes:
        progress: Where the searches for peaks stand.
        passes: Their two passes.
        regions: Peaks that are undecided.
        rests: See `REST`.
    """

    progress: Any
    passes: Any
    regions: Any
    rests: Any

    def of(self, rows: Sequence[int]) -> Columns:
        """Those of some nodes."""
        return Columns(*(each[:, rows] for each in self))

    def store(self, k: int, row: int, unit: ChannelUnit, before: int) -> None:
        """Take what a node's k-th channel remembers; so many samples are before its first one."""
        rest = self.rests[k, row]
        rest["lo"], rest["hi"], rest["known"] = (
            unit.baseline.lo, unit.baseline.hi, unit.baseline.known,
        )  # fmt: skip
        rest["past_lo"], rest["past_hi"] = unit.smoothing.lo, unit.smoothing.hi
        rest["fresh"], rest["silent"] = unit.smoothing.fresh, unit.silent
        rest["calibrating"], rest["since"] = unit.calibrating, unit.since + before
        detector = unit.detector
        if detector is None:
            return
        self.progress["index"][k, row] = detector.index + before
        self.progress["waiting"][k, row] = len(detector.undecided)
        for number, found in enumerate((detector.certain, detector.optimistic)):
            self.passes[k, row, number] = _pass(found, before)
        for number, span in enumerate(detector.undecided):
            self.regions[k, row, number] = (
                span.first + before, span.last + before, span.peaks,
                span.lowest, span.floor, span.ceiling,
            )  # fmt: skip

    def load(self, k: int, row: int, unit: ChannelUnit, first: int) -> None:
        """Let a node's k-th channel, set likewise, go on with its sample of a number."""
        rest = self.rests[k, row]
        unit.first = first
        unit.baseline.lo, unit.baseline.hi = float(rest["lo"]), float(rest["hi"])
        unit.baseline.known = bool(rest["known"])
        unit.smoothing.lo, unit.smoothing.hi = float(rest["past_lo"]), float(rest["past_hi"])
        unit.smoothing.fresh, unit.silent = bool(rest["fresh"]), int(rest["silent"])
        unit.calibrating, unit.since = bool(rest["calibrating"]), int(rest["since"])
        if unit.detector is not None:
            self._resume(k, row, unit.detector)

    def _resume(self, k: int, row: int, detector: PeakDetector) -> None:
        progress = self.progress[k, row]
        detector.index = int(progress["index"])
        for each, to in zip(
            self.passes[k, row], (detector.certain, detector.optimistic), strict=True
        ):
            if each["first"] != NONE:
                to.span = _span(each, detector.index - 1)
                to.valley, to.crest = float(each["valley"]), float(each["crest"])
                to.rising = bool(each["rising"])
        for region in self.regions[k, row, : int(progress["waiting"])]:
            span = _span(region, int(region["last"]))
            span.peaks = int(region["peaks"])
            detector.undecided.append(span)


def fresh(channels: int, nodes: int, longest: int) -> Columns:
    """Nothing is remembered; ``longest``: samples after which undecided peaks are reported."""
    shape = channels, nodes
    progress, rests = np.zeros(shape, PROGRESS), np.zeros(shape, REST)
    progress["longest"] = longest
    rests["fresh"] = 1
    passes = np.empty((*shape, 2), PASS)
    passes[:] = _NOWHERE
    return Columns(progress, passes, np.zeros((*shape, MOST_REGIONS + 1), REGION), rests)


def concatenate(parts: Sequence[Columns]) -> Columns:
    """All nodes of some columns."""
    return Columns(*(np.concatenate(each, axis=1) for each in zip(*parts, strict=True)))


def _pass(found: Hysteresis, before: int) -> tuple[float, ...]:
    span = found.span
    if span is None:
        return _NOWHERE
    crest = found.crest if found.rising else -inf
    place = span.first + before, found.rising, found.valley, crest
    return *place, span.lowest, span.floor, span.ceiling


def _span(given: Any, last: int) -> Span:
    span = Span(int(given["first"]), float(given["lowest"]), float(given["ceiling"]))
    span.last, span.floor = last, float(given["floor"])
    return span
