"""Messages at which the cloud fails are retried by themselves."""

from __future__ import annotations

import pytest
from eskin_gateway.forward.forwarder import RetryQueue
from eskin_gateway.spool.batch import SpoolMessage

ONE, TWO = (SpoolMessage("fingertip", 1, b"x", id=number) for number in (1, 2))


@pytest.fixture
def now() -> list[float]:
    return [100.0]


@pytest.fixture
def retry_queue(now: list[float]) -> RetryQueue:
    return RetryQueue(lambda: now[0])


def test_failed_message_is_retried_after_another_succeeds(
    retry_queue: RetryQueue,
) -> None:
    assert retry_queue.fault is None
    assert retry_queue.add(ONE)
    assert (retry_queue.ids, retry_queue.due()) == ((1,), None)
    retry_queue.succeeded([TWO])
    assert retry_queue.due() == ONE
    assert "1 message(s), one of fingertip" in str(retry_queue.fault)
    retry_queue.succeeded([ONE])
    assert (retry_queue.ids, retry_queue.due(), retry_queue.fault) == ((), None, None)


def test_delays_grow_up_to_a_minute(retry_queue: RetryQueue, now: list[float]) -> None:
    retry_queue.add(ONE)
    retry_queue.succeeded([TWO])
    for pause in (2.0, 4.0, 8.0, 16.0, 32.0, 60.0, 60.0):
        retry_queue.add(ONE)
        now[0] += pause - 0.01
        assert retry_queue.due() is None
        now[0] += 0.01
        assert retry_queue.due() == ONE


def test_delay_stays_bounded_after_days(retry_queue: RetryQueue, now: list[float]) -> None:
    retry_queue.add(ONE)
    retry_queue.succeeded([TWO])
    for _ in range(3000):
        assert retry_queue.due() == ONE
        retry_queue.add(ONE)
        assert retry_queue.due() is None
        now[0] += 60.0
    assert retry_queue.due() == ONE


def test_message_that_fails_otherwise_is_delayed_too(
    retry_queue: RetryQueue, now: list[float]
) -> None:
    retry_queue.delay(ONE)
    retry_queue.add(ONE)
    retry_queue.delay(ONE)
    assert retry_queue.due() is None
    retry_queue.succeeded([TWO])
    retry_queue.delay(ONE)
    assert retry_queue.due() is None
    now[0] += 2.0
    assert retry_queue.due() == ONE
    retry_queue.remove(ONE)
    assert (retry_queue.ids, retry_queue.due()) == ((), None)


def test_retried_messages_take_turns(retry_queue: RetryQueue, now: list[float]) -> None:
    retry_queue.add(ONE)
    retry_queue.add(TWO)
    retry_queue.succeeded([])
    for message in (ONE, TWO, ONE, TWO):
        assert retry_queue.due() == message
        retry_queue.add(message)
        now[0] += 60.0


def test_unconfirmed_failures_are_released(retry_queue: RetryQueue) -> None:
    retry_queue.add(ONE)
    retry_queue.succeeded([])
    retry_queue.add(TWO)
    assert retry_queue.release_unconfirmed()
    assert retry_queue.ids == (1,)
    assert not retry_queue.release_unconfirmed()


def test_queue_is_bounded(retry_queue: RetryQueue) -> None:
    for number in range(16):
        assert retry_queue.add(SpoolMessage("n", 1, b"", id=number))
    assert not retry_queue.add(SpoolMessage("n", 1, b"", id=16))
    assert len(retry_queue) == 16
