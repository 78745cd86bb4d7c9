"""A message at which the cloud fails is isolated, however it fails then."""

from __future__ import annotations

from contextlib import suppress
from typing import TYPE_CHECKING

import pytest
from eskin_gateway.forward.forwarder import RetryQueue
from eskin_gateway.spool.batch import Batch, SpoolMessage

from eskin.errors import CloudError
from tests.unit.gateway.forwarding import MESSAGES, MemoryCloud, Setup

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

ONE, TWO = (body for _, body in MESSAGES[:2])


@pytest.fixture
def now() -> list[float]:
    return [0.0]


@pytest.fixture
def cloud() -> MemoryCloud:
    made = MemoryCloud()
    made.failing = {ONE, TWO}
    return made


@pytest.fixture
def setup(tmp_path: Path, cloud: MemoryCloud, now: list[float]) -> Iterator[Setup]:
    """All but two messages are stored, and these are to be tried again now."""
    made = Setup(tmp_path, cloud, cloud)
    made.forwarder._retry_queue = RetryQueue(lambda: now[0])
    while made.spool.statistics.messages > len(cloud.failing):
        forward(made)
    now[0] += 60.0
    cloud.asked.clear()
    yield made
    made.spool.close()


def forward(setup: Setup) -> None:
    with suppress(CloudError):
        setup.forwarder.forward()


def add(setup: Setup, body: bytes) -> None:
    setup.spool.commit(Batch([SpoolMessage("n", 1, body)]))


def test_message_that_is_too_large_becomes_a_dead_letter(setup: Setup, cloud: MemoryCloud) -> None:
    cloud.failure = 413
    for _ in range(12):
        forward(setup)
    add(setup, b"new")
    forward(setup)
    statistics = setup.spool.statistics
    assert (statistics.messages, statistics.used, statistics.dead_letters) == (0, 0, 2)
    assert ("n", b"new") in cloud.stored
    assert setup.forwarder.retrying == 0
    assert setup.forwarder.fault is None


@pytest.mark.parametrize("failure", [500, 503, None])
def test_new_messages_come_between_retries(
    setup: Setup, cloud: MemoryCloud, now: list[float], failure: int | None
) -> None:
    cloud.failure = failure
    others = [b"new %d" % number for number in range(4)]
    for body in others:
        add(setup, body)
        forward(setup)
        forward(setup)
        now[0] += 60.0
    assert cloud.asked == [
        [ONE],
        others[:1],
        [TWO],
        others[1:2],
        [ONE],
        others[2:3],
        [TWO],
        others[3:],
    ]
