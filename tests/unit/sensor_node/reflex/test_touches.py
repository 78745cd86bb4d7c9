"""Scripted touches over the emulated chain; `benchmarks.reflexes` has a million of them."""

from __future__ import annotations

import pytest

from benchmarks.reflexes import GAUSSIAN, press

TOUCHES = 7_000


@pytest.mark.parametrize("rate", [-1.0, 1.0])
def test_no_touch_is_missed_and_none_invented(rate: float) -> None:
    for outcome in press(TOUCHES, seed=3, rate=rate).values():
        assert outcome.touches >= TOUCHES
        assert outcome.above > TOUCHES
        assert outcome.missed == outcome.false == 0


def test_what_gaussian_noise_breaks_is_within_the_coverage() -> None:
    found = press(TOUCHES, noise=GAUSSIAN, seed=4)
    for outcome in found.values():
        assert outcome.missed + outcome.false <= outcome.allowed
    assert found[""].missed + found[""].false > 0
