"""The shapes of answers that compare two channels."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Literal

from pydantic import BaseModel

from eskin.union_bound import union_coverage
from eskin.wire.timestamp import format_timestamp
from eskin_cloud.query.predicate import Verdict
from eskin_cloud.schemas.documents import IntervalDocument, Moment
from eskin_cloud.schemas.series import CountDocument
from eskin_cloud.schemas.shapes import seconds

if TYPE_CHECKING:
    from eskin_cloud.query.comparison_segments import ComparisonSegment
    from eskin_cloud.query.comparison_totals import ComparisonTotals
    from eskin_cloud.schemas.shapes import Json
    from eskin_cloud.store.read.window import Window


class StretchDocument(BaseModel):
    """A stretch of time with the same answer, ``end`` excluded.

    ``coverage`` is the probability of the whole statement: the union bound over all samples of
    both channels that it rests on.
    """

    id: str
    start: Moment
    end: Moment
    verdict: Literal["certain", "possible"]
    coverage: float


class StandingDocument(BaseModel):
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


def stretch_shape(stretch: ComparisonSegment, coverage: float) -> Json:
    """A stretch that is known; ``coverage`` is the least of a sample's."""
    verdict = "certain" if stretch.answer is Verdict.CERTAIN else "possible"
    return {
        "id": f"{stretch.start}-{stretch.end}-{verdict}",
        "start": format_timestamp(stretch.start),
        "end": format_timestamp(stretch.end),
        "verdict": verdict,
        "coverage": union_coverage(coverage, n=stretch.samples),
    }


def standing_shape(found: ComparisonTotals, window: Window, unit: str, coverage: float) -> Json:
    """For how long and how often; seconds are rounded outward."""
    least, most = found.time
    return {
        "start": format_timestamp(window.start),
        "end": format_timestamp(window.end),
        "unit": unit,
        "time_s": {"lo": seconds(least, -math.inf), "hi": seconds(most, math.inf)},
        "unknown_s": seconds(found.unknown, math.inf),
        "entries": {"lo": found.entries[0], "hi": found.entries[1]},
        "coverage": union_coverage(coverage, n=found.samples),
    }
