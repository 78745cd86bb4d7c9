"""What a record truly holds, and how the answers compare."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from benchmarks.gestures.scenes import THRESHOLD
from eskin.gestures import Templates, find_gestures
from eskin.gestures.templates import PAIR_KINDS
from eskin.interval import Verdict
from tests.unit.eskin.gestures.oracle import Truth
from tests.unit.eskin.gestures.worlds import angle_within, scale_within, within

if TYPE_CHECKING:
    from benchmarks.gestures.scenes import Record
    from eskin.gestures import Gesture, Gestures
    from tests.unit.eskin.gestures.oracle import Found

NONE: Final = "none"
SEVERAL: Final = "several"
_TEMPLATES: Final = Templates()


class Answer(NamedTuple):
    """What the templates say of a record.

    Attributes:
        label: What it truly holds, by the noise-free pressures.
        verdict: Of that: certain, possible, or impossible, which is a miss.
        certain: How many gestures are certain.
        wrong: How many of them the truth violates.
    """

    label: str
    verdict: Verdict
    certain: int
    wrong: int


def truth_of(record: Record) -> Truth:
    """What the oracle finds in a record's noise-free pressures, at its true instants."""
    pressed = [frozenset(np.flatnonzero(row > THRESHOLD).tolist()) for row in record.pressure]
    return Truth(record.skin, record.instants.tolist(), pressed, _TEMPLATES)


def judge(record: Record) -> Answer:
    """Recognise a record and compare with its truth."""
    instants, truth = record.instants.tolist(), truth_of(record)
    found = find_gestures(record.lo, record.hi, record.times, record.skin, THRESHOLD)
    label, wanted = label_of(truth)
    certain = list(found.certain)
    wrong = sum(not any(_fits(each, true, instants) for true in truth.gestures) for each in certain)
    if not wanted:
        own = [each for each in found if each.contacts]
        verdict = Verdict.POSSIBLE if own else Verdict.CERTAIN
    else:
        verdict = min(_best(found, true, instants) for true in wanted)
    return Answer(label, verdict, len(certain), wrong)


def label_of(truth: Truth) -> tuple[str, list[Found]]:
    """The label of a record, and the gestures that stand for it."""
    pairs = [each for each in truth.gestures if each.kind in PAIR_KINDS]
    if len(pairs) == 1:
        return pairs[0].kind, pairs
    if len(truth.touches) == 1:
        alone = truth.gestures
        return (alone[0].kind if alone else NONE), alone
    return (SEVERAL if truth.touches else NONE), truth.gestures


def _best(found: Gestures, true: Found, instants: list[int]) -> Verdict:
    own = [each.verdict for each in found if _fits(each, true, instants)]
    return max(own, default=Verdict.IMPOSSIBLE)


def _fits(answer: Gesture, true: Found, instants: list[int]) -> bool:
    """Whether an answer is about a gesture of the truth, with all its bounds."""
    return (
        answer.kind == true.kind
        and within(instants[true.first], answer.begin)
        and within(instants[true.last], answer.end)
        and angle_within(true.direction, answer.direction)
        and angle_within(true.angle, answer.angle)
        and scale_within(true.scale, answer.scale)
    )
