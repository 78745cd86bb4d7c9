"""The inbox is bounded, keeps order, and says how it fares."""

from __future__ import annotations

from threading import Thread

from eskin.envelope import MOST_ENVELOPE
from gateway.arrival import Arrival
from gateway.inbox import BATCH_BYTES, Inbox, InboxStatistics
from tests.processes import wait_until


def arrival(mid: int, size: int = 1) -> Arrival:
    return Arrival("t", bytes(size), mid, 1, retained=False, connection=1)


def test_full_inbox_refuses_and_counts() -> None:
    inbox = Inbox(2, most_bytes=10_000_000)
    assert [inbox.put([arrival(number)]) for number in range(3)] == [1, 1, 0]
    assert inbox.statistics == InboxStatistics(depth=2, capacity=2, most=2, refused=1, used=2)
    assert [a.mid for a in inbox.take(5, linger_s=0, wait_s=0)] == [0, 1]
    assert inbox.put([arrival(9)]) == 1


def test_inbox_full_of_bytes_refuses_and_takes_again_when_there_is_room() -> None:
    inbox = Inbox(100, most_bytes=2 * MOST_ENVELOPE)
    assert inbox.put([arrival(0, MOST_ENVELOPE)]) == 1
    was_full = [inbox.full]
    assert inbox.put([arrival(1, 1)]) == 1
    was_full.append(inbox.full)  # the next message might be one of the largest
    assert inbox.put([arrival(2, MOST_ENVELOPE)]) == 0
    assert inbox.statistics.used == MOST_ENVELOPE + 1
    assert inbox.statistics.refused == 1
    inbox.take(1, linger_s=0, wait_s=0)
    was_full.append(inbox.full)
    assert was_full == [False, True, False]
    assert inbox.put([arrival(2, MOST_ENVELOPE)]) == 1


def test_take_gives_batches_in_order() -> None:
    inbox = Inbox(100, most_bytes=10_000_000)
    for number in range(10):
        inbox.put([arrival(number)])
    taken = [inbox.take(4, linger_s=0, wait_s=0) for _ in range(4)]
    assert [[a.mid for a in batch] for batch in taken] == [
        [0, 1, 2, 3],
        [4, 5, 6, 7],
        [8, 9],
        [],
    ]


def test_take_ends_a_batch_that_grows_too_large() -> None:
    inbox = Inbox(100, most_bytes=10_000_000)
    for number in range(3):
        inbox.put([arrival(number, BATCH_BYTES // 2)])
    assert len(inbox.take(100, linger_s=0, wait_s=0)) == 2


def test_take_wakes_for_the_first_message_and_for_a_full_batch() -> None:
    inbox = Inbox(100, most_bytes=10_000_000)
    batches: list[int] = []
    taker = Thread(
        target=lambda: batches.append(len(inbox.take(3, linger_s=600.0, wait_s=600.0))),
        daemon=True,
    )
    taker.start()
    for number in range(3):
        inbox.put([arrival(number)])
    wait_until(lambda: batches == [3], "the batch is taken")
    taker.join()
