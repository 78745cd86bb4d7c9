"""A supervised thread survives errors, backs off and stops; delays grow and stay bounded."""

from __future__ import annotations

from random import Random
from threading import Event

import pytest

from eskin.errors import CloudError, EskinError
from eskin.runtime.supervised import MAX_RETRY_AFTER_S, Backoff, Supervised
from tests.support.processes import wait_until


def make_backoff(first: float = 1.0, most: float = 8.0) -> Backoff:
    return Backoff(first, most, random=Random(3))  # noqa: S311 - jitter, repeatable


def test_delays_double_up_to_the_limit_with_jitter() -> None:
    backoff = make_backoff()
    delays = [backoff.failed() for _ in range(2000)]
    for delay, limit in zip(delays, [1.0, 2.0, 4.0] + [8.0] * 1997, strict=True):
        assert limit / 2 <= delay <= limit
    assert len(set(delays)) == 2000


def test_success_resets_the_delay() -> None:
    backoff = make_backoff()
    for _ in range(10):
        backoff.failed()
    backoff.succeeded()
    assert backoff.failed() <= 1.0


def test_retry_after_is_respected_up_to_a_limit() -> None:
    backoff = make_backoff()
    assert backoff.failed(at_least=100.0) == 100.0
    assert backoff.failed(at_least=1e12) == MAX_RETRY_AFTER_S


class Steps:
    """Steps that fail or succeed as stated."""

    def __init__(self, *errors: Exception, idle_s: float = 0.001, drain_s: float = 0.0) -> None:
        self.errors = list(errors)
        self.failures: list[Exception] = []
        self.left = 0
        self.rounds = 0
        self.thread = Supervised(
            "worker",
            self.step,
            backoff=make_backoff(0.001, 0.001),
            idle_s=idle_s,
            drain_s=drain_s,
            on_failure=self.failures.append,
        )

    def step(self) -> bool:
        self.rounds += 1
        if self.errors:
            raise self.errors[0]
        self.thread.succeeded()
        self.left = max(0, self.left - 1)
        return self.left > 0


@pytest.mark.parametrize("error", [EskinError("away"), OSError("away"), ZeroDivisionError("away")])
def test_failures_are_counted_and_logged_once_until_a_success(
    error: Exception, caplog: pytest.LogCaptureFixture
) -> None:
    steps = Steps(error)
    steps.thread.start()
    wait_until(lambda: len(steps.failures) > 3, "it retries")
    unexpected = isinstance(error, ZeroDivisionError)
    assert steps.thread.fault == ("unexpected error: ZeroDivisionError" if unexpected else "away")
    assert len(caplog.records) == 1
    assert bool(caplog.records[0].exc_info) == unexpected
    steps.errors.clear()
    wait_until(lambda: steps.thread.fault is None, "it succeeds")
    steps.errors.append(error)
    wait_until(lambda: len(caplog.records) == 2, "it is logged again")
    steps.thread.stop()


def test_stop_interrupts_a_long_delay() -> None:
    steps = Steps(CloudError("busy", retry_after=3000.0))
    steps.thread.start()
    wait_until(lambda: bool(steps.failures), "it fails")
    steps.thread.stop()
    assert steps.rounds == 1


def test_stop_drains_what_is_left_and_gives_up_after_a_failure() -> None:
    steps = Steps(idle_s=3000.0, drain_s=3000.0)
    steps.thread.start()
    wait_until(lambda: steps.rounds == 1, "it is idle")
    steps.left = 5
    steps.thread.stop()
    assert (steps.left, steps.rounds) == (0, 6)
    failing = Steps(idle_s=3000.0, drain_s=3000.0)
    failing.thread.start()
    wait_until(lambda: failing.rounds == 1, "it is idle")
    failing.errors.append(OSError("away"))
    failing.thread.stop()
    assert failing.rounds == 2


def test_drain_ends_after_its_time() -> None:
    begun = Event()

    def endless() -> bool:
        begun.set()
        return True

    thread = Supervised("worker", endless, backoff=make_backoff(), drain_s=0.05)
    thread.start()
    assert begun.wait(60)
    thread.stop()


def test_stop_before_start_does_nothing() -> None:
    steps = Steps()
    steps.thread.stop()
    assert steps.rounds == 0
