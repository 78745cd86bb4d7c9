"""The bounded queue between the broker's thread and the commit loop."""

from __future__ import annotations

import time
from collections import deque
from dataclasses import dataclass
from threading import Condition
from typing import TYPE_CHECKING, Final

from eskin.wire.envelope import MOST_ENVELOPE

if TYPE_CHECKING:
    from collections.abc import Sequence

    from eskin_gateway.mqtt.transport import ReceivedMessage

BATCH_BYTES: Final = 1_048_576
"""Bytes at which a batch ends. Its last message may exceed them."""


@dataclass(frozen=True, slots=True)
class ReceiveQueueStatistics:
    """State of the receive queue.

    Attributes:
        depth: Queued messages.
        capacity: Most messages.
        peak: Most messages queued so far.
        dropped: Messages dropped because the queue was full.
        used: Queued bytes.
    """

    depth: int
    capacity: int
    peak: int
    dropped: int
    used: int


class ReceiveQueue:
    """Received messages in order. One thread puts, one takes.

    Args:
        capacity: Most messages.
        most_bytes: Most bytes. One message always has room.
    """

    def __init__(self, capacity: int, *, most_bytes: int) -> None:
        self._capacity = capacity
        self._most_bytes = most_bytes
        self._used = 0
        self._waiting: deque[ReceivedMessage] = deque()
        self._changed = Condition()
        self._wanted = 1
        self._peak = 0
        self._dropped = 0

    def put(self, received_messages: Sequence[ReceivedMessage]) -> int:
        """Add messages in order and return how many had room. Others are counted as dropped."""
        with self._changed:
            taken = self._room_for(received_messages)
            self._waiting.extend(received_messages[:taken])
            self._dropped += len(received_messages) - taken
            depth = len(self._waiting)
            self._peak = max(self._peak, depth)
            # A wake-up costs more than a message, so the taker waits for as many as it wants.
            if taken and depth >= self._wanted:
                self._changed.notify()
            return taken

    def _room_for(self, received_messages: Sequence[ReceivedMessage]) -> int:
        """Reserve room and return how many of the messages have it."""
        depth, used = len(self._waiting), self._used
        for count, received_message in enumerate(received_messages):
            depth, used = depth + 1, used + len(received_message.payload)
            if depth > self._capacity or (used > self._most_bytes and depth > 1):
                return count
            self._used = used
        return len(received_messages)

    @property
    def full(self) -> bool:
        """Whether the next message may find no room."""
        return len(self._waiting) >= self._capacity or self._used > self._most_bytes - MOST_ENVELOPE

    def take(self, most: int, *, linger_s: float, wait_s: float) -> list[ReceivedMessage]:
        """Take a batch of the oldest messages, or none.

        Args:
            most: Most messages.
            linger_s: Seconds to wait for more after the first.
            wait_s: Seconds to wait for the first.
        """
        with self._changed:
            self._await(1, wait_s)
            if self._waiting:
                self._await(most, linger_s)
            batch: list[ReceivedMessage] = []
            size = 0
            while self._waiting and len(batch) < most and size < BATCH_BYTES:
                received_message = self._waiting.popleft()
                size += len(received_message.payload)
                batch.append(received_message)
            self._used -= size
            return batch

    def _await(self, wanted: int, seconds: float) -> None:
        deadline = time.monotonic() + seconds
        self._wanted = min(wanted, self._capacity)
        while len(self._waiting) < self._wanted:
            left = deadline - time.monotonic()
            if left <= 0 or not self._changed.wait(left):
                return

    @property
    def statistics(self) -> ReceiveQueueStatistics:
        """Current state."""
        with self._changed:
            return ReceiveQueueStatistics(
                len(self._waiting), self._capacity, self._peak, self._dropped, self._used
            )
