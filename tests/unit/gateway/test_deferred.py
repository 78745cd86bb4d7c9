"""What the cloud fails at is left out only while it takes others, and is tried again."""

from __future__ import annotations

import pytest
from eskin_gateway.forward.retry_queue import RetryQueue
from eskin_gateway.spool.spool import Stored

ONE, TWO = (Stored(number, "fingertip", 1, b"x") for number in (1, 2))


@pytest.fixture
def now() -> list[float]:
    return [100.0]


@pytest.fixture
def deferred(now: list[float]) -> RetryQueue:
    return RetryQueue(lambda: now[0])


def test_suspect_is_left_out_and_tried_again_at_once_when_another_was_taken(
    deferred: RetryQueue,
) -> None:
    assert deferred.fault is None
    assert deferred.hold(ONE)
    assert (deferred.ids, deferred.due()) == ((1,), None)
    deferred.taken([TWO])
    assert deferred.due() == ONE
    assert "1 message(s), one of fingertip" in str(deferred.fault)
    deferred.taken([ONE])
    assert (deferred.ids, deferred.due(), deferred.fault) == ((), None, None)


def test_pauses_grow_up_to_a_minute(deferred: RetryQueue, now: list[float]) -> None:
    deferred.hold(ONE)
    deferred.taken([TWO])
    for pause in (2.0, 4.0, 8.0, 16.0, 32.0, 60.0, 60.0):
        deferred.hold(ONE)
        now[0] += pause - 0.01
        assert deferred.due() is None
        now[0] += 0.01
        assert deferred.due() == ONE


def test_pause_is_no_longer_after_days(deferred: RetryQueue, now: list[float]) -> None:
    deferred.hold(ONE)
    deferred.taken([TWO])
    for _ in range(3000):
        assert deferred.due() == ONE
        deferred.hold(ONE)
        assert deferred.due() is None
        now[0] += 60.0
    assert deferred.due() == ONE


def test_one_that_fails_otherwise_is_put_off_too(deferred: RetryQueue, now: list[float]) -> None:
    deferred.put_off(ONE)
    deferred.hold(ONE)
    deferred.put_off(ONE)
    assert deferred.due() is None
    deferred.taken([TWO])
    deferred.put_off(ONE)
    assert deferred.due() is None
    now[0] += 2.0
    assert deferred.due() == ONE
    deferred.forget(ONE)
    assert (deferred.ids, deferred.due()) == ((), None)


def test_those_that_are_held_take_turns(deferred: RetryQueue, now: list[float]) -> None:
    deferred.hold(ONE)
    deferred.hold(TWO)
    deferred.taken([])
    for message in (ONE, TWO, ONE, TWO):
        assert deferred.due() == message
        deferred.hold(message)
        now[0] += 60.0


def test_when_nothing_tells_whose_fault_it_is_none_is_left_out(deferred: RetryQueue) -> None:
    deferred.hold(ONE)
    deferred.taken([])
    deferred.hold(TWO)
    assert deferred.release_suspects()
    assert deferred.ids == (1,)
    assert not deferred.release_suspects()


def test_so_many_failures_one_after_another_are_the_clouds(deferred: RetryQueue) -> None:
    for number in range(16):
        assert deferred.hold(Stored(number, "n", 1, b""))
    assert not deferred.hold(Stored(16, "n", 1, b""))
    assert len(deferred) == 16
