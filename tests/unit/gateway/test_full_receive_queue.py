"""A gateway whose receive queue is full holds the broker back and loses nothing."""

from __future__ import annotations

from contextlib import contextmanager
from typing import TYPE_CHECKING

from eskin_gateway.service import Gateway

from eskin.errors import SpoolError
from eskin.wire.topics import Stream
from tests.support.processes import wait_until
from tests.unit.gateway.messages import frame, status

if TYPE_CHECKING:
    from collections.abc import Iterator

    import pytest
    from eskin_gateway.settings import GatewaySettings
    from eskin_gateway.spool.batch import Batch

    from tests.unit.gateway.stub_cloud import StubCloud
    from tests.unit.gateway.wire_node import WireNode


def test_full_queue_holds_the_broker_back_and_loses_nothing(
    settings: GatewaySettings, cloud: StubCloud, node: WireNode, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Pings far longer than the test: nothing is dropped to keep the broker's connection alive.
    section = settings.broker.model_copy(update={"receive_queue_messages": 16, "keepalive_s": 600})
    running = Gateway(settings.model_copy(update={"broker": section}))
    running.start()
    wait_until(lambda: running.broker.connected, "the gateway is connected")
    node.say(Stream.STATUS, status(0))
    node.wait_for((1, 0))
    commit = running.spool.commit
    monkeypatch.setattr(running.spool, "commit", full_disk)
    for number in range(1, 200):
        node.say(Stream.FRAMES, frame(number))
    wait_until(
        lambda: running.receive_queue.full and running.commit_loop.fault is not None, "no more room"
    )
    assert node.acknowledged == {(1, 0)}
    monkeypatch.setattr(running.spool, "commit", commit)
    node.wait_for(*((1, number) for number in range(200)))
    wait_until(lambda: len(cloud.stored) == 200, "the cloud stored all")
    assert running.receive_queue.statistics.peak == 16
    assert running.receive_queue.statistics.dropped == 0
    running.stop()


@contextmanager
def stopping(gateway: Gateway) -> Iterator[None]:
    """A gateway that is stopped whatever fails: the stub cloud waits for its connections."""
    try:
        yield
    finally:
        gateway.stop()


def full_disk(batch: Batch) -> None:
    raise SpoolError(f"database or disk is full ({len(batch.messages)} messages)")


def test_dropped_messages_are_released_at_the_broker(
    settings: GatewaySettings, node: WireNode, monkeypatch: pytest.MonkeyPatch
) -> None:
    section = settings.broker.model_copy(update={"receive_queue_messages": 16, "keepalive_s": 6})
    running = Gateway(settings.model_copy(update={"broker": section}))
    with stopping(running):
        running.start()
        wait_until(lambda: running.broker.connected, "the gateway is connected")
        node.say(Stream.STATUS, status(0))
        node.wait_for((1, 0))
        commit = running.spool.commit
        monkeypatch.setattr(running.spool, "commit", full_disk)
        for number in range(1, 1500):  # more than the broker's window of 1000
            node.say(Stream.FRAMES, frame(number))
        wait_until(lambda: running.receive_queue.statistics.dropped > 1000, "messages are dropped")
        wait_until(lambda: running.broker.connected, "the gateway is still connected")
        monkeypatch.setattr(running.spool, "commit", commit)
        wait_until(lambda: running.receive_queue.statistics.depth == 0, "the queue is empty")
        # Sends again, as a node does, what was dropped meanwhile.
        resent = iter(range(10**6))

        def heard() -> bool:
            if next(resent) % 50 == 0:
                node.say(Stream.STATUS, status(2000))
            return (1, 2000) in node.acknowledged

        wait_until(heard, "the gateway takes messages again")
