"""What other threads leave for the broker's thread to send."""

from __future__ import annotations

from collections import deque
from typing import Final

MOST: Final = 20_000
"""Messages."""
MOST_BYTES: Final = 33_554_432


class SendQueue:
    """A bounded queue of packets; one thread puts, one takes.

    PUBACKs are not counted: there are no more than arrivals.
    """

    def __init__(self) -> None:
        self._waiting: deque[tuple[bytes, int | None]] = deque()
        # Bytes that came and that went, ever: each is counted by one thread alone.
        self._came = self._went = 0

    def __len__(self) -> int:
        return len(self._waiting)

    def put(self, publication: bytes) -> bool:
        """Add a PUBLISH; ``False`` where there is no room."""
        if len(self._waiting) >= MOST or self._came - self._went >= MOST_BYTES:
            return False
        self._came += len(publication)
        self._waiting.append((publication, None))
        return True

    def acknowledge(self, acknowledgements: bytes, *, connection: int) -> None:
        """Add PUBACKs, which are good on one connection alone."""
        self._waiting.append((acknowledgements, connection))

    def take(self, connection: int) -> bytes | None:
        """The oldest that is good on a connection; ``None`` where none waits."""
        while self._waiting:
            packet, bound = self._waiting.popleft()
            if bound is None:
                self._went += len(packet)
            # On another connection an identifier may name another message.
            if bound is None or bound == connection:
                return packet
        return None
