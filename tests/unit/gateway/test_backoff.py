"""Waits grow, stay bounded, and never agree with one another."""

from __future__ import annotations

from random import Random

from eskin_gateway.backoff import MOST_PATIENCE_S, Backoff


def test_waits_double_up_to_the_limit_with_jitter() -> None:
    backoff = Backoff(1.0, 8.0, random=Random(3))  # noqa: S311 - jitter, repeatable
    waits = [backoff.failed() for _ in range(2000)]
    for wait, limit in zip(waits, [1.0, 2.0, 4.0] + [8.0] * 1997, strict=True):
        assert limit / 2 <= wait <= limit
    assert len(set(waits)) == 2000


def test_success_starts_over() -> None:
    backoff = Backoff(1.0, 8.0, random=Random(3))  # noqa: S311 - jitter, repeatable
    for _ in range(10):
        backoff.failed()
    backoff.succeeded()
    assert backoff.failed() <= 1.0


def test_peers_wish_is_honoured_within_reason() -> None:
    backoff = Backoff(1.0, 8.0, random=Random(3))  # noqa: S311 - jitter, repeatable
    assert backoff.failed(at_least=100.0) == 100.0
    assert backoff.failed(at_least=1e12) == MOST_PATIENCE_S
