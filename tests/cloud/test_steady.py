"""A clock that goes wrong for a while removes nothing."""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING, Any

import pytest

from cloud import retention
from cloud.retention import retain, sweep
from cloud.settings import RetentionSection
from cloud.steady import DOUBT, LEAP, Steady
from tests.cloud.clouds import batch, count_blocks, standing
from tests.cloud.messages import START, block

if TYPE_CHECKING:
    from pathlib import Path

    from tests.identities import Identities

YEAR = 365 * 86_400 * 10**9


class Time:
    """A clock, and what passes in truth."""

    def __init__(self) -> None:
        self.wrong = 0
        self.passed = 7
        self.steady = Steady(lambda: START + self.passed + self.wrong, ticks=lambda: self.passed)

    def is_right(self) -> bool:
        return self.steady() == START + self.passed


def test_leap_ahead_is_not_believed_for_a_day() -> None:
    time = Time()
    assert time.is_right()
    time.wrong = YEAR
    for hours in (0, 1, 22):
        time.passed += hours * LEAP
        assert time.is_right()
    time.wrong = 0
    assert time.is_right()
    time.wrong = YEAR
    assert time.is_right(), "it is doubted anew"
    time.passed += DOUBT - 1
    assert time.is_right()
    time.passed += 1
    assert time.steady() == START + time.passed + YEAR


def test_clock_that_is_set_back_or_goes_ahead_a_little_is_followed() -> None:
    time = Time()
    for wrong in (LEAP, LEAP // 2, -YEAR, -YEAR + LEAP):
        time.wrong = wrong
        assert time.steady() == START + time.passed + wrong
    time.wrong = 0
    assert time.steady() == START + time.passed - YEAR + LEAP


@pytest.mark.anyio
async def test_year_that_a_clock_leapt_ahead_removes_nothing(
    tmp_path: Path, identities: Identities, monkeypatch: pytest.MonkeyPatch
) -> None:
    sweeps = 0

    async def counted(*given: Any, **named: Any) -> int:
        nonlocal sweeps
        removed = await sweep(*given, **named)
        sweeps += 1
        return removed

    monkeypatch.setattr(retention, "sweep", counted)
    rules = RetentionSection(days=1, every_s=0.001)
    with standing(tmp_path, identities, retention=rules) as stand:
        await stand.ingest(batch(*(block(n) for n in range(5))))
        stopping = asyncio.Event()
        running = asyncio.create_task(retain(stand.cloud, stopping))
        for moment in (stand.clock.now, START + YEAR):
            stand.clock.now, seen = moment, sweeps
            while sweeps < seen + 3:  # noqa: ASYNC110 - done by the code under test
                await asyncio.sleep(0.001)
        stopping.set()
        await running
        assert count_blocks(stand) == 5
