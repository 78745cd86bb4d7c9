"""Packets that other threads queue for the broker."""

from __future__ import annotations

from collections import deque
from typing import Final

MOST: Final = 20_000
"""Messages."""
MOST_BYTES: Final = 33_554_432


class SendQueue:
    """A bounded queue of packets. One thread puts, one takes.

    PUBACKs are not counted: there are no more than received messages.
    """

    def __init__(self) -> None:
        self._waiting: deque[tuple[bytes, int | None]] = deque()
        # Bytes ever put and ever taken. One thread writes each counter.
        self._put = self._taken = 0

    def __len__(self) -> int:
        return len(self._waiting)

    def put(self, publication: bytes) -> bool:
        """Add a PUBLISH; return whether there was room."""
        if len(self._waiting) >= MOST or self._put - self._taken >= MOST_BYTES:
            return False
        self._put += len(publication)
        self._waiting.append((publication, None))
        return True

    def acknowledge(self, acknowledgements: bytes, *, connection: int) -> None:
        """Add PUBACKs, which are valid on one connection only."""
        self._waiting.append((acknowledgements, connection))

    def take(self, connection: int) -> bytes | None:
        """Take the oldest packet that is valid on a connection, if there is one."""
        while self._waiting:
            packet, bound_to = self._waiting.popleft()
            if bound_to is None:
                self._taken += len(packet)
            # On another connection, the identifier may name another message.
            if bound_to in {None, connection}:
                return packet
        return None
