"""Two of two hundred lives of a taxel, and that wrong assumptions show up in them."""

from __future__ import annotations

import pytest

from benchmarks.lives import DRIFT, Life, live, summarise

STEADY, LATE = 1001, 1002


@pytest.fixture(scope="module")
def lived() -> list[Life]:
    return [live(seed, 500) for seed in (STEADY, LATE)]


def test_no_statement_about_a_life_is_wrong(lived: list[Life]) -> None:
    rows = summarise(lived)
    assert [row.name for row in rows if row.met is False] == []
    for life in lived:
        assert life.product.enclosures > 1900
        assert life.product.width < 0.015
        assert life.stiffness.width < 0.2


def test_wear_becomes_certain_and_its_end_is_enclosed(lived: list[Life]) -> None:
    assert [life.kind for life in lived] == ["steady", "late"]
    for life in lived:
        assert life.product.certain is not None
        assert life.product.failed is not None
    assert lived[0].product.finite > 100  # a constant rate bounds the remaining time from above


def test_drift_that_is_stated_too_small_shows() -> None:
    life = live(LATE, 500, drift=DRIFT / 50.0)
    assert life.product.outside > 0


def test_too_few_outliers_show() -> None:
    life = live(LATE, 500, outliers=10)
    assert life.wrong > 10
    assert life.product.outside > 0
