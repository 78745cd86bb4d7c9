"""A clock that goes wrong for a while removes nothing."""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING, Any

import pytest
from eskin_cloud.jobs import retention
from eskin_cloud.jobs.clock_guard import ABSENCE, DOUBT, LEAP, ClockGuard
from eskin_cloud.jobs.retention import Rounds, apply_retention, sweep
from eskin_cloud.settings import RetentionSection
from eskin_cloud.store.write.clock_state import ClockReading, load_clock

from tests.unit.cloud.clouds import batch, count_frames, standing
from tests.unit.cloud.messages import START, stretch

if TYPE_CHECKING:
    from pathlib import Path

    from eskin_cloud.store.location import StoreLocation

    from tests.support.identities import Identities

YEAR = 365 * 86_400 * 10**9


class Time:
    """A clock, and what passes in truth."""

    def __init__(self) -> None:
        self.wrong = 0
        self.passed = 7
        self.steady = self._start(None)

    def _start(self, last: ClockReading | None) -> ClockGuard:
        clock, begun = lambda: START + self.passed + self.wrong, self.passed
        return ClockGuard(clock, ticks=lambda: self.passed - begun, last=last)

    def restart(self, *, off: int = 0, wrong: int | None = None) -> None:
        """The cloud and its machine, which counts what passes, are off; the clock goes wrong."""
        last = self.steady.read()
        self.passed += off
        self.wrong = self.wrong if wrong is None else wrong
        self.steady = self._start(last)

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


def test_leap_after_a_leap_is_not_believed_for_a_day_of_its_own() -> None:
    time = Time()
    time.wrong = 2 * LEAP
    assert time.is_right()
    time.passed += DOUBT - LEAP
    time.wrong = YEAR
    assert time.is_right()
    time.passed += LEAP
    assert time.is_right()
    time.wrong = 2 * LEAP
    time.passed += DOUBT - LEAP
    assert time.steady() == START + time.passed + 2 * LEAP


def test_clock_that_is_set_back_or_goes_ahead_a_little_is_followed() -> None:
    time = Time()
    for wrong in (LEAP, LEAP // 2, -YEAR, -YEAR + LEAP):
        time.wrong = wrong
        assert time.steady() == START + time.passed + wrong
    time.wrong = 0
    assert time.steady() == START + time.passed - YEAR + LEAP


def test_clock_that_is_wrong_at_the_start_is_not_believed_for_a_day() -> None:
    time = Time()
    time.restart(wrong=YEAR)
    assert time.is_right()
    time.passed += DOUBT - 1
    assert time.is_right()
    time.restart()
    assert time.is_right()
    time.passed += 1
    assert not time.is_right(), "it was in doubt for a day, with a restart between"


def test_clock_that_leaps_on_while_it_is_in_doubt_is_doubted_anew() -> None:
    for restarted in (False, True):
        time = Time()
        time.wrong = YEAR
        assert time.is_right()
        time.passed += DOUBT - 1
        if restarted:
            time.restart(wrong=3 * YEAR)
        time.wrong = 3 * YEAR
        assert time.is_right()
        time.passed += DOUBT - 1
        assert time.is_right()
        time.passed += 1
        assert not time.is_right()


def test_clock_that_is_set_right_after_the_start_is_followed_at_once() -> None:
    time = Time()
    time.restart(wrong=YEAR)
    time.passed += LEAP
    time.wrong = 0
    assert time.is_right()
    assert time.steady.read() == ClockReading(START + time.passed)


def test_cloud_that_was_off_for_long_removes_nothing_on_its_first_day() -> None:
    time = Time()
    time.restart(off=ABSENCE)
    assert time.is_right()
    time.restart(off=ABSENCE + 1)
    assert time.steady() == START + time.passed - ABSENCE - 1
    time.passed += DOUBT
    assert time.is_right()


@pytest.mark.anyio
async def test_cloud_that_starts_with_a_clock_a_year_ahead_removes_nothing(
    tmp_path: Path, identities: Identities, place: StoreLocation
) -> None:
    with standing(tmp_path, identities, place=place, retention=RetentionSection(days=1)) as stand:
        await stand.ingest(batch(*(stretch(n) for n in range(5))))
        await Rounds(stand.cloud)()
        right = stand.clock()
        stand.clock.now = right + YEAR
        for _ in range(3):
            await Rounds(stand.cloud)()
        assert count_frames(stand) == 5
        with stand.cloud.store.read() as connection:
            kept = load_clock(connection)
        assert kept is not None
        assert right <= kept.believed < right + LEAP
        assert kept.ahead > YEAR - LEAP


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
        await stand.ingest(batch(*(stretch(n) for n in range(5))))
        stopping = asyncio.Event()
        running = asyncio.create_task(apply_retention(stand.cloud, stopping))
        for instant in (stand.clock.now, START + YEAR):
            stand.clock.now, seen = instant, sweeps
            while sweeps < seen + 3:  # noqa: ASYNC110 - done by the code under test
                await asyncio.sleep(0.001)
        stopping.set()
        await running
        assert count_frames(stand) == 5
