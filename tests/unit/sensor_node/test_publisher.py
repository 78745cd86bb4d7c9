"""A node's publisher against a real broker and a tiny gateway."""

from __future__ import annotations

import logging
import time
from typing import TYPE_CHECKING, Any

import paho.mqtt.client as mqtt
import pytest

from eskin.errors import FlashError
from eskin.wire.envelope import MOST_ENVELOPE, Sealer
from eskin.wire.frames import Frame, Statements
from eskin.wire.messages import Acknowledgement, Position, Status
from eskin.wire.topics import Stream, node_topic
from tests.support.processes import wait_until
from tests.unit.sensor_node.designs import Bench, waiting
from tests.unit.sensor_node.peer import Peer

if TYPE_CHECKING:
    from collections.abc import Callable

    from tests.support.brokers import Mosquitto
    from tests.support.identities import Identities


def its_broker(**settings: float) -> pytest.MarkDecorator:
    """Let the node publish with these settings of its broker."""
    return pytest.mark.parametrize("bench", [{"broker": settings}], indirect=True)


def empty(bench: Bench) -> bool:
    return bench.outbox.messages == 0


def test_messages_are_forgotten_after_the_gateway_s_acknowledgement(
    bench: Bench, broker: Mosquitto, identities: Identities, publishing: Callable[..., Any]
) -> None:
    bench.run_to(3.0)
    before = {Position(*kept.position): kept.body for kept in waiting(bench.flash)}
    with Peer(identities, broker.gateway_port) as peer, publishing():
        wait_until(lambda: empty(bench), "flash is empty")
        assert {p: m.encode() for p, m in peer.messages.items() if p in before} == before
        kinds = {type(message) for message in peer.messages.values()}
        assert kinds == {Frame, Statements, Status}
        # It introduces itself before anything else, so no message came from an unknown node.
        assert isinstance(peer.messages[peer.order[0]], Status)
        assert peer.unintroduced == 0
        # Apart from the status, the oldest came first.
        others = [position for position in peer.order if position in before]
        frames = [p for p in others if isinstance(peer.messages[p], Frame)]
        assert frames == sorted(frames)


def test_broker_s_word_alone_forgets_nothing(
    bench: Bench, broker: Mosquitto, identities: Identities, publishing: Callable[..., Any]
) -> None:
    bench.run_to(1.0)
    count = bench.outbox.messages
    with Peer(identities, broker.gateway_port, acknowledging=False) as peer, publishing():
        wait_until(lambda: len(peer.messages) > count, "all arrived")
        # Sent again, without an acknowledgement.
        wait_until(lambda: min(peer.copies.values()) >= 2, "all came twice")
        assert bench.outbox.messages == len(peer.messages)
        assert peer.held == Position(1, 0)
        peer.acknowledging = True
        wait_until(lambda: empty(bench), "flash is empty")


@its_broker(silence_s=0.3)
def test_connection_without_answers_is_made_anew(
    bench: Bench,
    broker: Mosquitto,
    identities: Identities,
    publishing: Callable[..., Any],
    caplog: pytest.LogCaptureFixture,
) -> None:
    bench.run_to(1.0)
    caplog.set_level(logging.INFO, "eskin_sensor_node.link.publisher")
    with Peer(identities, broker.gateway_port, acknowledging=False) as peer, publishing():
        wait_until(lambda: caplog.text.count("connected: broker") >= 2, "it has connected again")
        assert "reconnecting" in caplog.text
        peer.acknowledging = True
        wait_until(lambda: empty(bench), "flash is empty")


def test_word_that_is_too_long_for_one_is_not_kept(publishing: Callable[..., Any]) -> None:
    message = mqtt.MQTTMessage(topic=node_topic("fingertip", Stream.ACKS).encode())
    with publishing() as publisher:
        kept = publisher._inboxes[publisher._acks_topic]
        publisher._until = 0.0
        publisher._thread.join()
        for size in (MOST_ENVELOPE + 1, MOST_ENVELOPE):
            message.payload = bytes(size)
            publisher._on_message(None, None, message)
        assert [len(word) for word in kept.queue] == [MOST_ENVELOPE]


def test_held_follows_what_is_acknowledged(
    bench: Bench, broker: Mosquitto, identities: Identities, publishing: Callable[..., Any]
) -> None:
    bench.run_to(1.0)
    with Peer(identities, broker.gateway_port, acknowledging=False) as peer, publishing():
        wait_until(lambda: len(peer.messages) > 24, "all arrived")
        peer.acknowledge("fingertip", [Position(1, n) for n in range(10)])
        wait_until(lambda: peer.held == Position(1, 10), "held is stated")


@its_broker(window=10)
def test_window_bounds_what_is_in_flight(
    bench: Bench, broker: Mosquitto, identities: Identities, publishing: Callable[..., Any]
) -> None:
    bench.run_to(4.0)
    with Peer(identities, broker.gateway_port, acknowledging=False) as peer, publishing():
        wait_until(lambda: min(peer.copies.values(), default=0) >= 3, "sent three times")
        # The status goes first and takes its place in the window, too.
        assert isinstance(peer.messages[peer.order[0]], Status)
        assert set(peer.order[1:]) == {Position(1, n) for n in range(9)}
        peer.acknowledging = True
        wait_until(lambda: empty(bench), "flash is empty")
        assert len(peer.messages) > 96


def test_forged_acknowledgement_forgets_nothing(
    bench: Bench,
    broker: Mosquitto,
    identities: Identities,
    publishing: Callable[..., Any],
    caplog: pytest.LogCaptureFixture,
) -> None:
    bench.run_to(1.0)
    with Peer(identities, broker.gateway_port, acknowledging=False) as peer, publishing():
        wait_until(lambda: len(peer.messages) > 24, "all arrived")
        acks = node_topic("fingertip", Stream.ACKS)
        everything = Acknowledgement(0, ((1, 0, 1000),)).encode()
        forger = Sealer(identities.gateway, identities.node.certificate)
        mutant = bytearray(
            Sealer(identities.site, identities.node.certificate).seal(everything, topic=acks)
        )
        mutant[-1] ^= 1
        forged = [everything, forger.seal(everything, topic=acks), bytes(mutant)]
        for envelope in forged:
            peer.client.publish(acks, envelope, qos=1)
        peer.acknowledge("fingertip", [Position(1, 0)], topic="eskin/v1/nodes/palm/acks")

        def rejected() -> int:
            return sum("acknowledgement rejected" in r.message for r in caplog.records)

        wait_until(lambda: rejected() == 4, "all four are rejected")
        assert bench.outbox.messages >= 25
        assert bench.outbox.held() == (1, 0)


@its_broker(status_s=0.2)
def test_newest_status_is_retained_and_repeated(
    broker: Mosquitto, identities: Identities, publishing: Callable[..., Any]
) -> None:
    with Peer(identities, broker.gateway_port) as peer, publishing():
        wait_until(lambda: len(peer.messages) >= 4, "status comes again and again")
        newest = max(peer.messages)
    with Peer(identities, broker.gateway_port) as late:
        wait_until(lambda: len(late.messages) == 1, "a status waits for latecomers")
        assert late.retained == {node_topic("fingertip", Stream.STATUS): 1}
        assert next(iter(late.messages)) >= newest


@its_broker(status_s=0.1)
def test_status_carries_the_latest_gateway_time_that_was_received(
    broker: Mosquitto, identities: Identities, publishing: Callable[..., Any]
) -> None:
    def statuses() -> list[Status]:
        return [message for message in peer.messages.values() if isinstance(message, Status)]

    begun = time.time_ns()
    with Peer(identities, broker.gateway_port) as peer, publishing():
        wait_until(lambda: len(statuses()) >= 4, "status comes again and again")
        stated = [status.gateway_time for status in statuses()]
        assert stated[0] is None
        later = [each for each in stated if each is not None]
        assert later == sorted(set(later))
        assert all(begun <= each <= time.time_ns() for each in later)
        peer.acknowledge("fingertip", [max(peer.messages)], time_ns=begun)
        known = max(later)
        count = len(statuses())
        wait_until(lambda: len(statuses()) > count + 1, "statuses after an older time")
        assert all((s.gateway_time or known) >= known for s in statuses()[count:])


@its_broker(status_s=0.1, resend_s=0.2)
def test_no_status_piles_up_while_no_gateway_answers(
    bench: Bench, broker: Mosquitto, identities: Identities, publishing: Callable[..., Any]
) -> None:
    with (
        Peer(identities, broker.gateway_port, acknowledging=False) as peer,
        publishing(),
    ):
        wait_until(lambda: max(peer.copies.values(), default=0) >= 4, "sent again and again")
        assert bench.outbox.messages == 1
        peer.acknowledging = True
        wait_until(lambda: len(peer.messages) >= 3, "statuses come again")


def test_broker_that_dies_and_comes_back_loses_nothing(
    bench: Bench,
    broker: Mosquitto,
    identities: Identities,
    publishing: Callable[..., Any],
    caplog: pytest.LogCaptureFixture,
) -> None:
    caplog.set_level(logging.INFO)
    bench.run_to(1.0)
    with publishing():
        with Peer(identities, broker.gateway_port) as peer:
            wait_until(lambda: empty(bench), "flash is empty")
        first = set(peer.messages)  # also what it took while it left
        broker.kill()
        bench.run_to(3.0)
        assert not empty(bench)
        wait_until(
            lambda: any("connection lost" in r.message for r in caplog.records), "it is noticed"
        )
        broker.begin()
        with Peer(identities, broker.gateway_port) as again:
            wait_until(lambda: empty(bench), "flash is empty again")
            sequences = {p.sequence for p in first | set(again.messages)}
    assert sequences == set(range(len(sequences)))


def test_full_disk_does_not_keep_waiting_messages_from_going_out(
    bench: Bench, broker: Mosquitto, identities: Identities, publishing: Callable[..., Any]
) -> None:
    bench.run_to(2.0)
    said = bench.outbox.messages

    def fail() -> Position:
        raise FlashError("the disk is full")

    bench.node.record_status = fail  # type: ignore[method-assign]  # a fault is injected
    with Peer(identities, broker.gateway_port) as peer, publishing():
        # No client introduced the node, but its messages arrive.
        wait_until(lambda: peer.unintroduced >= said, "all arrived")


@pytest.mark.nightly
@pytest.mark.parametrize(
    "bench",
    [{"radio": {"bandwidth_bytes_per_s": 60_000, "loss": 0.3, "packet_bytes": 512, "tries": 2}}],
    indirect=True,
)
def test_lossy_and_narrow_air_delays_and_loses_nothing(
    bench: Bench, broker: Mosquitto, identities: Identities, publishing: Callable[..., Any]
) -> None:
    bench.run_to(1.0)
    before = {Position(*kept.position): kept.body for kept in waiting(bench.flash)}
    size = sum(len(body) for body in before.values())
    with Peer(identities, broker.gateway_port) as peer:
        begun = time.monotonic()
        with publishing():
            wait_until(lambda: empty(bench), "flash is empty")
        took = time.monotonic() - begun
    assert {p: m.encode() for p, m in peer.messages.items() if p in before} == before
    # With envelopes and repeats; 0.2 s are on the air ahead.
    assert 1.2 * size < bench.traffic.sent < 60_000 * (took + 0.3)
    assert bench.traffic.received > 0


@pytest.mark.nightly
@its_broker(drain_s=60.0)
def test_stop_waits_for_acknowledgements_in_the_pipe(
    bench: Bench, broker: Mosquitto, identities: Identities, publishing: Callable[..., Any]
) -> None:
    with Peer(identities, broker.gateway_port) as peer:
        with publishing() as publisher:
            wait_until(lambda: bool(peer.messages), "connected")
            bench.run_to(5.0)
            publisher.notify()
        assert empty(bench)
        assert len(peer.messages) > 120
