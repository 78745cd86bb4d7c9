"""Answers that compare two channels."""

import math
from typing import Literal

from pydantic import BaseModel
from typing_extensions import TypedDict

from eskin.union_bound import union_coverage
from eskin.wire.timestamp import format_timestamp
from eskin_cloud.query.comparison_segments import ComparisonSegment, ComparisonTotals
from eskin_cloud.schemas.base import CountDocument, IntervalDocument, Moment, seconds
from eskin_cloud.schemas.series import verdict_of
from eskin_cloud.store.read.window import Window


class ComparisonSegmentDocument(TypedDict):
    """A stretch of time with the same answer, ``end`` excluded.

    ``coverage`` is the probability of the whole statement: the union bound over all samples of
    both channels that it rests on.
    """

    id: str
    start: Moment
    end: Moment
    verdict: Literal["certain", "possible"]
    coverage: float


class ComparisonTotalsDocument(BaseModel):
    """For how long and how often a channel is above or below another, over a window.

    For ``unknown_s`` one of both is not known; ``entries`` counts how often the state began while
    both are. ``coverage`` is the probability of the whole statement.
    """

    start: Moment
    end: Moment
    unit: str
    time_s: IntervalDocument
    unknown_s: float
    entries: CountDocument
    coverage: float


def describe_comparison_segment(segment: ComparisonSegment) -> ComparisonSegmentDocument:
    """A stretch that is known."""
    verdict = verdict_of(segment.answer)
    return {
        "id": f"{segment.start}-{segment.end}-{verdict}",
        "start": format_timestamp(segment.start),
        "end": format_timestamp(segment.end),
        "verdict": verdict,
        "coverage": union_coverage(segment.coverage, n=segment.samples),
    }


def describe_comparison_totals(
    found: ComparisonTotals, window: Window, unit: str
) -> ComparisonTotalsDocument:
    """For how long and how often; seconds are rounded outward."""
    least, most = found.time
    return ComparisonTotalsDocument(
        start=format_timestamp(window.start),
        end=format_timestamp(window.end),
        unit=unit,
        time_s={"lo": seconds(least, -math.inf), "hi": seconds(most, math.inf)},
        unknown_s=seconds(found.unknown, math.inf),
        entries={"lo": found.entries[0], "hi": found.entries[1]},
        coverage=union_coverage(found.coverage, n=found.samples),
    )
