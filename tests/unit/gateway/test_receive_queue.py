"""The receive queue is bounded and ordered, and reports its state."""

from __future__ import annotations

from threading import Thread

from eskin_gateway.mqtt.receive_queue import BATCH_BYTES, ReceiveQueue, ReceiveQueueStatistics
from eskin_gateway.mqtt.transport import ReceivedMessage

from eskin.wire.envelope import MOST_ENVELOPE
from tests.support.processes import wait_until


def received_message(mid: int, size: int = 1) -> ReceivedMessage:
    return ReceivedMessage("t", bytes(size), mid, 1, retained=False, connection=1)


def test_full_queue_drops_and_counts() -> None:
    receive_queue = ReceiveQueue(2, most_bytes=10_000_000)
    assert [receive_queue.put([received_message(number)]) for number in range(3)] == [1, 1, 0]
    assert receive_queue.statistics == ReceiveQueueStatistics(
        depth=2, capacity=2, peak=2, dropped=1, used=2
    )
    assert [a.mid for a in receive_queue.take(5, linger_s=0, wait_s=0)] == [0, 1]
    assert receive_queue.put([received_message(9)]) == 1


def test_queue_is_bounded_in_bytes() -> None:
    receive_queue = ReceiveQueue(100, most_bytes=2 * MOST_ENVELOPE)
    assert receive_queue.put([received_message(0, MOST_ENVELOPE)]) == 1
    was_full = [receive_queue.full]
    assert receive_queue.put([received_message(1, 1)]) == 1
    was_full.append(receive_queue.full)  # the next message might be one of the largest
    assert receive_queue.put([received_message(2, MOST_ENVELOPE)]) == 0
    assert receive_queue.statistics.used == MOST_ENVELOPE + 1
    assert receive_queue.statistics.dropped == 1
    receive_queue.take(1, linger_s=0, wait_s=0)
    was_full.append(receive_queue.full)
    assert was_full == [False, True, False]
    assert receive_queue.put([received_message(2, MOST_ENVELOPE)]) == 1


def test_take_gives_batches_in_order() -> None:
    receive_queue = ReceiveQueue(100, most_bytes=10_000_000)
    for number in range(10):
        receive_queue.put([received_message(number)])
    taken = [receive_queue.take(4, linger_s=0, wait_s=0) for _ in range(4)]
    assert [[a.mid for a in batch] for batch in taken] == [
        [0, 1, 2, 3],
        [4, 5, 6, 7],
        [8, 9],
        [],
    ]


def test_take_ends_a_batch_that_grows_too_large() -> None:
    receive_queue = ReceiveQueue(100, most_bytes=10_000_000)
    for number in range(3):
        receive_queue.put([received_message(number, BATCH_BYTES // 2)])
    assert len(receive_queue.take(100, linger_s=0, wait_s=0)) == 2


def test_take_wakes_for_the_first_message_and_for_a_full_batch() -> None:
    receive_queue = ReceiveQueue(100, most_bytes=10_000_000)
    batches: list[int] = []
    taker = Thread(
        target=lambda: batches.append(len(receive_queue.take(3, linger_s=600.0, wait_s=600.0))),
        daemon=True,
    )
    taker.start()
    for number in range(3):
        receive_queue.put([received_message(number)])
    wait_until(lambda: batches == [3], "the batch is taken")
    taker.join()
