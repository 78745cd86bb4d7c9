"""No certain answer is wrong, none that the truth needs is missing, and what is known is said."""

from __future__ import annotations

from collections import Counter

import numpy as np

from eskin.gestures.templates import PAIR_KINDS, TOUCH_KINDS
from tests.unit.eskin.gestures.worlds import check, draw_world

WORLDS = 300


def test_answers_hold_in_random_worlds() -> None:
    random = np.random.default_rng(1)
    counts: Counter[str] = Counter()
    for _ in range(WORLDS):
        world = draw_world(random)
        counts += check(world, world.found())
    for kind in (*TOUCH_KINDS, *PAIR_KINDS):
        assert counts[f"true {kind}"] > 1, kind
        assert counts[f"{kind} possible"] > 10, kind


def test_what_is_known_is_certain() -> None:
    random = np.random.default_rng(2)
    certain: Counter[str] = Counter()
    true: Counter[str] = Counter()
    for _ in range(WORLDS):
        world = draw_world(random, known=True)
        found = world.found()
        check(world, found)
        own = Counter(str(each.kind) for each in found.certain)
        both = Counter(each.kind for each in world.truth().gestures)
        assert own <= both
        certain, true = certain + own, true + both
    # Of contacts that merge later, only boxes of places are known: one of 300 stays possible.
    assert certain.total() >= 0.99 * true.total()
    assert min(certain[kind] for kind in (*TOUCH_KINDS, *PAIR_KINDS)) > 1, certain
