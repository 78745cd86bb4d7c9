"""Answers about a channel's samples."""

import math
from typing import Literal

from pydantic import BaseModel
from typing_extensions import TypedDict

from eskin.interval import Verdict
from eskin.union_bound import union_coverage
from eskin.wire.timestamp import format_timestamp
from eskin_cloud.query.occupancy import Occupancy
from eskin_cloud.query.segments import Segment
from eskin_cloud.query.series import Series
from eskin_cloud.schemas.base import CountDocument, IntervalDocument, Json, Moment, Row, seconds
from eskin_cloud.store.read.window import Window


class BoundsDocument(BaseModel):
    """Lower and upper bounds, one of each for each entry of a series."""

    lo: list[float | None]
    hi: list[float | None]


class SeriesDocument(BaseModel):
    """A series.

    Where one of lo and hi is null, that side is unbounded; where both are, nothing is known. A
    sample holds at its instant, a hull over ``[t, t + dt)``; ``mean`` encloses the mean of each
    hull's samples, and is null where entries are samples.
    """

    node: str
    channel: str
    unit: str
    coverage: float
    resolution: Literal["sample", "hull"]
    t0: Moment
    t: list[int]
    lo: list[float | None]
    hi: list[float | None]
    mean: BoundsDocument | None
    dt: int
    time_error: int


class SegmentDocument(TypedDict):
    """A run of samples, from the first to the last, with the same answer.

    ``coverage`` is the probability of the whole statement: the union bound over its samples. Their
    true moments lie within ``time_error`` ns of the stated ones.
    """

    id: str
    start: Moment
    end: Moment
    verdict: Literal["certain", "possible"]
    coverage: float
    time_error: int


class OccupancyDocument(BaseModel):
    """For how long and how often a channel is in a state, over a window.

    A sample holds until the next, for its period at most; for ``unknown_s`` nothing is known.
    ``samples`` and ``entries`` count what is known: samples in the state, and how often it began.
    Samples are those stated within the window; their true moments lie within ``time_error``
    ns of these, and ``time_s`` holds wherever they do. ``coverage`` is the probability of the whole
    statement.
    """

    start: Moment
    end: Moment
    unit: str
    time_s: IntervalDocument
    unknown_s: float
    samples: CountDocument
    entries: CountDocument
    coverage: float
    time_error: int


def describe_series(series: Series) -> Json:
    """A series."""
    return {
        "node": series.node,
        "channel": series.channel,
        "unit": series.unit,
        "coverage": series.coverage,
        "resolution": series.resolution,
        "t0": format_timestamp(series.t0),
        "t": series.t,
        "lo": series.lo,
        "hi": series.hi,
        "mean": None if series.mean is None else {"lo": series.mean[0], "hi": series.mean[1]},
        "dt": series.dt,
        "time_error": series.time_error,
    }


def verdict_of(answer: Verdict | None) -> Literal["certain", "possible"]:
    """A verdict that is listed: what is impossible is left out."""
    return "certain" if answer is Verdict.CERTAIN else "possible"


def describe_segment(segment: Segment) -> SegmentDocument:
    """A segment of a threshold's answer.

    Its coverage is the union bound over its samples, at the least coverage of them.
    """
    verdict = verdict_of(segment.answer)
    return {
        "id": f"{segment.start}-{segment.end}-{verdict}",
        "start": format_timestamp(segment.start),
        "end": format_timestamp(segment.end),
        "verdict": verdict,
        "coverage": union_coverage(segment.coverage, n=segment.n),
        "time_error": segment.error,
    }


def describe_occupancy(found: Occupancy, window: Window, channel: Row) -> OccupancyDocument:
    """For how long and how often a channel is in a state; seconds are rounded outward."""
    least, most = found.time
    return OccupancyDocument(
        start=format_timestamp(window.start),
        end=format_timestamp(window.end),
        unit=channel["unit"],
        time_s={"lo": seconds(least, -math.inf), "hi": seconds(most, math.inf)},
        unknown_s=seconds(found.unknown, math.inf),
        samples={"lo": found.samples[0], "hi": found.samples[1]},
        entries={"lo": found.entries[0], "hi": found.entries[1]},
        coverage=union_coverage(found.coverage, n=found.n),
        time_error=found.error,
    )
