"""Emulated gestures against their truth; ``make nightly`` has a hundred times as many."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from benchmarks.gestures.features import features
from benchmarks.gestures.judge import judge
from benchmarks.gestures.scenes import CONDITIONS, SCRIPTS, Skins
from eskin.interval import Verdict

if TYPE_CHECKING:
    from pathlib import Path

    from benchmarks.gestures.scenes import Condition

EACH = 25


@pytest.mark.nightly
@pytest.mark.parametrize("condition", CONDITIONS, ids=lambda each: each.name)
def test_no_certain_gesture_is_wrong_and_none_is_missed(
    condition: Condition, tmp_path: Path
) -> None:
    answers = [judge(record) for record in Skins(tmp_path).play(condition, EACH, seed=1)]
    assert len(answers) == EACH
    assert sum(answer.wrong for answer in answers) == 0
    assert all(answer.verdict > Verdict.IMPOSSIBLE for answer in answers)
    certain = sum(answer.verdict is Verdict.CERTAIN for answer in answers)
    assert certain >= (0.95 * EACH if condition.name == "clean" else 1)


def test_classifier_sees_as_much_of_each_record(tmp_path: Path) -> None:
    records = list(Skins(tmp_path).play(CONDITIONS[2], len(SCRIPTS), seed=2))
    assert [record.script for record in records] == list(SCRIPTS)
    empty = records[0]._replace(lo=np.zeros_like(records[0].lo), hi=np.ones_like(records[0].hi))
    rows = [features(record) for record in [*records, empty]]
    assert len({len(row) for row in rows}) == 1
    assert np.all(np.isfinite(rows))
