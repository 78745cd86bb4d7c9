"""Answers about monitors."""

import math
from typing import Literal

from pydantic import BaseModel
from typing_extensions import TypedDict

from eskin.monitor import Because
from eskin.wire.timestamp import format_timestamp
from eskin_cloud.query.stored_verdicts import StoredPiece
from eskin_cloud.query.verdict_totals import VerdictTotals
from eskin_cloud.schemas.base import CountDocument, Instant, IntervalDocument, seconds
from eskin_cloud.store.read.window import Window


class VerdictDocument(TypedDict):
    """A stretch of time with one verdict.

    ``includes_start`` and ``includes_end`` say whether the first and the last instant belong to it.
    ``because`` says why a verdict is possible; where it is ``missing``, it could hold by samples
    alone that do not exist. ``coverage`` is the probability with which it is right in its middle,
    at least.
    """

    start: Instant
    includes_start: bool
    end: Instant
    includes_end: bool
    verdict: Literal["certain", "possible", "impossible"]
    because: list[Literal["width", "instant", "gap", "pending"]]
    missing: bool
    coverage: float


class TotalsDocument(BaseModel):
    """For how long, and how often, a formula holds over a window.

    For ``unknown_s`` it could hold by samples alone that do not exist. So it held for ``time_s.lo``
    at least, and for ``time_s.hi`` and ``unknown_s`` together at most. ``entries`` counts the
    stretches in which it holds, without those in which missing samples may change it. ``coverage``
    is the probability of the whole statement.
    """

    start: Instant
    end: Instant
    time_s: IntervalDocument
    unknown_s: float
    entries: CountDocument
    coverage: float


class FormulaTotalsDocument(TotalsDocument):
    """For how long, and how often, a formula holds, and how often it is wrong.

    ``false_a_year`` is the expected number of false verdicts a year, at most, if one is taken at
    each sample of each of its channels, as often as those of the window come; 0 where all errors
    are bounded.
    """

    false_a_year: float


def describe_verdict(piece: StoredPiece) -> VerdictDocument:
    """One stretch."""
    verdict: Literal["certain", "possible", "impossible"]
    verdict = piece.verdict.name.lower()  # type: ignore[assignment]  # one of them
    because: list[Literal["width", "instant", "gap", "pending"]]
    because = [each.name.lower() for each in Because if each in piece.because]  # type: ignore[misc,union-attr]
    return {
        "start": format_timestamp(piece.first // 2),
        "includes_start": piece.first % 2 == 0,
        "end": format_timestamp((piece.last + 1) // 2),
        "includes_end": piece.last % 2 == 0,
        "verdict": verdict,
        "because": because,
        "missing": piece.missing,
        "coverage": piece.coverage,
    }


def describe_totals(found: VerdictTotals, window: Window, coverage: float) -> TotalsDocument:
    """For how long, and how often; seconds are rounded outward."""
    least, most = found.time
    return TotalsDocument(
        start=format_timestamp(window.start),
        end=format_timestamp(window.end),
        time_s={"lo": seconds(least, -math.inf), "hi": seconds(most, math.inf)},
        unknown_s=seconds(found.unknown, math.inf),
        entries={"lo": found.entries[0], "hi": found.entries[1]},
        coverage=coverage,
    )
