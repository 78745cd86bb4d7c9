"""Two of two hundred lives of a taxel, and that wrong assumptions and empty answers show up."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from benchmarks import lives
from benchmarks.lives import DRIFT, KINDS, Emulated, Life, draw_world, identify, summarise
from eskin.interval import Interval

STEADY, LATE = 1001, 1002
DAYS = 400


@pytest.fixture(scope="module")
def pads() -> list[Emulated]:
    return [
        Emulated(seed, draw_world(seed, DAYS, KINDS[seed % len(KINDS)])) for seed in (STEADY, LATE)
    ]


@pytest.fixture(scope="module")
def lived(pads: list[Emulated]) -> list[Life]:
    return [identify(pad) for pad in pads]


def failed(found: list[Life]) -> list[str]:
    return [row.name for row in summarise(found) if row.met is False]


@pytest.mark.nightly
def test_no_statement_about_a_life_is_wrong(lived: list[Life]) -> None:
    assert failed(lived) == []
    for life in lived:
        assert life.product.enclosures > 1500
        assert life.product.width < 0.015
        assert life.stiffness.width < 0.15


@pytest.mark.nightly
def test_wear_becomes_certain_and_its_end_is_enclosed(lived: list[Life]) -> None:
    assert [life.kind for life in lived] == ["steady", "late"]
    for life in lived:
        assert life.product.certain is not None
        assert life.product.failed is not None
    assert lived[0].product.finite > 100  # a constant rate bounds the remaining time from above


@pytest.mark.nightly
@pytest.mark.parametrize("wrong", [{"drift": DRIFT / 50.0}, {"outliers": 10}])
def test_assumption_that_does_not_hold_shows(wrong: dict[str, Any], pads: list[Emulated]) -> None:
    assert identify(pads[1], **wrong).product.outside > 0


@pytest.mark.parametrize(
    ("bounds", "shows"),
    [((0.0, float("inf")), "C0: that delay"), ((1190.0, 1212.0), "C0: true value outside")],
)
def test_estimator_that_learns_nothing_fails(
    bounds: tuple[float, float],
    shows: str,
    pads: list[Emulated],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """One that answers nothing, or its data sheet of C0 over the oscillator's factor."""

    def learn_nothing(_earliest: Any, _latest: Any, _x: Any, times: Any, *_: Any, **__: Any) -> Any:
        return Interval(*np.repeat(bounds, len(times)).reshape(2, -1))

    monkeypatch.setattr(lives, "estimate", learn_nothing)
    assert any(name.startswith(shows) for name in failed([identify(pads[1])]))
