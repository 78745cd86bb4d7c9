"""Nothing is acknowledged before it is durable."""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING

import pytest

from eskin.wire.frames import DescribedLayout
from eskin.wire.topics import Stream, live_topic, node_topic
from tests.support.processes import wait_until
from tests.unit.gateway.messages import CHANNEL, frame, status

if TYPE_CHECKING:
    from eskin_gateway.mqtt.transport import ReceivedMessage
    from eskin_gateway.spool.batch import Batch

    from eskin.wire.frames import EncodedFrame, Privacy
    from tests.unit.gateway.in_memory import Inside
    from tests.unit.gateway.wire_node import Seal

ACKS = node_topic("fingertip", Stream.ACKS)


def introduce(inside: Inside, seal: Seal) -> None:
    inside.introduce(seal)
    inside.broker.published.clear()
    inside.broker.released.clear()


def test_nothing_is_published_before_the_commit(
    inside: Inside, seal: Seal, monkeypatch: pytest.MonkeyPatch
) -> None:
    introduce(inside, seal)
    said_at_commit: list[int] = []
    commit = inside.spool.commit

    def watched(batch: Batch) -> None:
        said_at_commit.append(len(inside.broker.published) + len(inside.broker.released))
        commit(batch)

    monkeypatch.setattr(inside.spool, "commit", watched)
    inside.arrive(Stream.FRAMES, seal("fingertip", Stream.FRAMES, frame(1).encode()))
    assert said_at_commit == [0]
    assert len(inside.broker.on(ACKS)) == 1
    assert len(inside.broker.on(live_topic("fingertip", CHANNEL))) == 1
    assert len(inside.broker.released) == 1


def test_full_spool_holds_the_batch_and_recovers_by_itself(inside: Inside, seal: Seal) -> None:
    introduce(inside, seal)
    inside.spool.failures = 10**6
    inside.receive_queue.put(
        [inside.received_message(Stream.FRAMES, seal("fingertip", Stream.FRAMES, BODY))]
    )
    inside.commit_loop.start()
    wait_until(lambda: inside.commit_loop.fault is not None, "the commit fails")
    assert "disk is full" in str(inside.commit_loop.fault)
    assert inside.broker.published == []
    assert inside.broker.released == []
    inside.spool.failures = 0
    wait_until(lambda: len(inside.broker.released) == 1, "it goes on")
    wait_until(lambda: inside.commit_loop.fault is None, "it is healthy again")
    inside.commit_loop.stop()
    assert inside.stored() == [status(0).encode(), BODY]
    assert inside.metrics.value("spool_commit_failures_total") >= 1


def test_stop_while_full_leaves_the_batch_with_the_node(inside: Inside, seal: Seal) -> None:
    introduce(inside, seal)
    inside.spool.failures = 10**6
    inside.receive_queue.put(
        [inside.received_message(Stream.FRAMES, seal("fingertip", Stream.FRAMES, BODY))]
    )
    inside.commit_loop.start()
    wait_until(lambda: inside.commit_loop.fault is not None, "the commit fails")
    inside.commit_loop.stop()
    assert inside.broker.published == []
    assert inside.stored() == [status(0).encode()]


def test_stop_while_full_acknowledges_no_copy_of_the_batch(inside: Inside, seal: Seal) -> None:
    introduce(inside, seal)
    inside.spool._capacity = inside.spool._used + 10
    inside.receive_queue.put(
        [inside.received_message(Stream.FRAMES, seal("fingertip", Stream.FRAMES, BODY))]
    )
    inside.commit_loop.start()
    wait_until(lambda: inside.commit_loop.fault is not None, "the commit fails")
    # The node, unanswered, sends again.
    inside.receive_queue.put(
        [inside.received_message(Stream.FRAMES, seal("fingertip", Stream.FRAMES, BODY))]
    )
    inside.commit_loop.stop()
    assert inside.broker.on(ACKS) == []
    assert inside.stored() == [status(0).encode()]


def test_failed_batch_is_no_duplicate_when_it_is_resent(
    inside: Inside, seal: Seal, monkeypatch: pytest.MonkeyPatch
) -> None:
    introduce(inside, seal)
    commit = inside.spool.commit

    def broken(batch: Batch) -> None:
        monkeypatch.setattr(inside.spool, "commit", commit)
        raise ZeroDivisionError(f"a bug with {len(batch.messages)} messages")

    monkeypatch.setattr(inside.spool, "commit", broken)
    envelope = seal("fingertip", Stream.FRAMES, BODY)
    inside.receive_queue.put([inside.received_message(Stream.FRAMES, envelope)])
    inside.commit_loop.start()
    wait_until(lambda: len(inside.broker.released) == 1, "the broker may forget it")
    assert inside.rejected() == {"internal_error": 1}
    assert inside.broker.on(ACKS) == []
    inside.receive_queue.put([inside.received_message(Stream.FRAMES, envelope)])
    wait_until(lambda: len(inside.broker.on(ACKS)) == 1, "sent again, it is acknowledged")
    inside.commit_loop.stop()
    assert inside.stored() == [status(0).encode(), BODY]


def test_message_that_causes_a_bug_blocks_no_other(
    inside: Inside, seal: Seal, monkeypatch: pytest.MonkeyPatch
) -> None:
    introduce(inside, seal)
    require = DescribedLayout.require_frame

    def breaks(skin: DescribedLayout, said: EncodedFrame) -> Privacy:
        if said.position.sequence == 1:
            raise ZeroDivisionError("a bug with this message")
        return require(skin, said)

    monkeypatch.setattr(DescribedLayout, "require_frame", breaks)
    bodies = [frame(number).encode() for number in (1, 2, 3)]
    inside.commit_loop.process_or_split(
        [
            inside.received_message(Stream.FRAMES, seal("fingertip", Stream.FRAMES, body))
            for body in bodies
        ]
    )
    assert inside.stored() == [status(0).encode(), *bodies[1:]]
    assert inside.rejected() == {"internal_error": 1}
    assert len(inside.broker.on(ACKS)) == 2
    assert sorted(inside.broker.released) == [4, 5, 6]
    monkeypatch.undo()
    inside.arrive(Stream.FRAMES, seal("fingertip", Stream.FRAMES, BODY))
    assert inside.stored()[-1] == BODY, "it was not taken for known"


def test_nodes_stay_online_while_the_broker_is_away(inside: Inside, seal: Seal) -> None:
    introduce(inside, seal)
    answers = inside.commit_loop._post_commit
    answers.run_periodic()
    inside.broker.connected = False
    inside.clock.seconds += 100.0
    answers.run_periodic()
    inside.broker.connected = True
    answers.run_periodic()
    assert inside.broker.published == []
    inside.clock.seconds += 16.0
    answers.run_periodic()
    assert len(inside.broker.on(live_topic("fingertip", "status"))) == 1


BODY = frame(1).encode()


@pytest.mark.nightly
def test_nodes_expire_also_under_constant_load(
    inside: Inside, seal: Seal, monkeypatch: pytest.MonkeyPatch
) -> None:
    introduce(inside, seal)
    looked = threading.Event()
    monkeypatch.setattr(inside.post_commit, "run_periodic", looked.set)

    def never_empty(*_: object, **__: object) -> list[ReceivedMessage]:
        return [inside.received_message(Stream.FRAMES, b"whatever")]

    monkeypatch.setattr(inside.receive_queue, "take", never_empty)
    inside.commit_loop.start()
    assert looked.wait(60)
    monkeypatch.undo()
    inside.commit_loop.stop()
