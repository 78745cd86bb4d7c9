"""Answers about monitors."""

from typing import Literal

from typing_extensions import TypedDict

from eskin.monitor import Because
from eskin.wire.timestamp import format_timestamp
from eskin_cloud.query.stored_verdicts import StoredPiece
from eskin_cloud.schemas.base import Moment


class VerdictDocument(TypedDict):
    """A stretch of time with one verdict.

    ``includes_start`` and ``includes_end`` say whether the first and the last instant belong to it.
    ``because`` says why a verdict is possible. ``coverage`` is the probability with which it is
    right at one instant, at least.
    """

    start: Moment
    includes_start: bool
    end: Moment
    includes_end: bool
    verdict: Literal["impossible", "possible", "certain"]
    because: list[Literal["width", "moment", "gap", "pending"]]
    coverage: float


def describe_verdict(piece: StoredPiece) -> VerdictDocument:
    """One stretch."""
    verdict: Literal["impossible", "possible", "certain"]
    verdict = piece.verdict.name.lower()  # type: ignore[assignment]  # one of them
    because: list[Literal["width", "moment", "gap", "pending"]]
    because = [each.name.lower() for each in Because if each in piece.because]  # type: ignore[misc,union-attr]
    return {
        "start": format_timestamp(piece.first // 2),
        "includes_start": piece.first % 2 == 0,
        "end": format_timestamp((piece.last + 1) // 2),
        "includes_end": piece.last % 2 == 0,
        "verdict": verdict,
        "because": because,
        "coverage": piece.coverage,
    }
