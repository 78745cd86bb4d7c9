"""The bounded queue between the broker's thread and the spool's."""

from __future__ import annotations

import time
from collections import deque
from dataclasses import dataclass
from threading import Condition
from typing import TYPE_CHECKING, Final

from eskin.wire.envelope import MOST_ENVELOPE

if TYPE_CHECKING:
    from collections.abc import Sequence

    from eskin_gateway.mqtt.received_message import ReceivedMessage

BATCH_BYTES: Final = 1_048_576
"""Most bytes of one batch (one message more may start below it)."""


@dataclass(frozen=True, slots=True)
class ReceiveQueueStatistics:
    """How the inbox fares.

    Attributes:
        depth: Messages waiting.
        capacity: Most that may wait.
        most: Most that ever waited.
        refused: Messages that found it full, and were dropped without acknowledgement.
        used: Bytes waiting.
    """

    depth: int
    capacity: int
    most: int
    refused: int
    used: int


class ReceiveQueue:
    """Holds arrivals in order; one thread puts, one takes.

    Args:
        capacity: Most messages.
        most_bytes: Most bytes; one message has room in any case.
    """

    def __init__(self, capacity: int, *, most_bytes: int) -> None:
        self._capacity = capacity
        self._most_bytes = most_bytes
        self._used = 0
        self._waiting: deque[ReceivedMessage] = deque()
        self._changed = Condition()
        self._wanted = 1
        self._most = 0
        self._refused = 0

    def put(self, received_messages: Sequence[ReceivedMessage]) -> int:
        """Add some, in order; gives how many found room. What found none is counted."""
        with self._changed:
            taken = self._room_for(received_messages)
            self._waiting.extend(received_messages[:taken])
            self._refused += len(received_messages) - taken
            depth = len(self._waiting)
            self._most = max(self._most, depth)
            # The taker says how many are worth waking it for: a wake-up costs more than a message.
            if taken and depth >= self._wanted:
                self._changed.notify()
            return taken

    def _room_for(self, received_messages: Sequence[ReceivedMessage]) -> int:
        """How many of them have room, and now take it."""
        depth, used = len(self._waiting), self._used
        for count, received_message in enumerate(received_messages):
            depth, used = depth + 1, used + len(received_message.payload)
            if depth > self._capacity or (used > self._most_bytes and depth > 1):
                return count
            self._used = used
        return len(received_messages)

    @property
    def room(self) -> int:
        """How many messages more it may take."""
        return max(0, self._capacity - len(self._waiting))

    @property
    def full(self) -> bool:
        """Whether the next message would find no room, or might not."""
        return len(self._waiting) >= self._capacity or self._used > self._most_bytes - MOST_ENVELOPE

    def take(self, most: int, *, linger_s: float, wait_s: float) -> list[ReceivedMessage]:
        """Take a batch.

        Args:
            most: Most messages in it.
            linger_s: How long to wait for more, once there is one.
            wait_s: How long to wait for the first.

        Returns:
            The oldest messages in order; empty where none came.
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
        """How it fares now."""
        with self._changed:
            return ReceiveQueueStatistics(
                len(self._waiting), self._capacity, self._most, self._refused, self._used
            )
