"""What other threads leave for the broker's thread to send."""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING, Final, TypeAlias

from gateway.arrival import Arrival

if TYPE_CHECKING:
    from collections.abc import Sequence

Publication: TypeAlias = tuple[str, bytes, bool]
"""Topic, payload, and whether the broker keeps it."""

MOST: Final = 20_000
"""Messages."""
MOST_BYTES: Final = 33_554_432


class Outgoing:
    """A bounded queue; one thread puts, one takes.

    PUBACKs are not counted: there are no more than arrivals.
    """

    def __init__(self) -> None:
        self._waiting: deque[Publication | Arrival] = deque()
        # Bytes that came and that went, ever: each is counted by one thread alone.
        self._came = self._went = 0

    def __len__(self) -> int:
        return len(self._waiting)

    def put(self, publication: Publication) -> bool:
        """Add a publication; ``False`` where there is no room."""
        if len(self._waiting) >= MOST or self._came - self._went >= MOST_BYTES:
            return False
        self._came += len(publication[1])
        self._waiting.append(publication)
        return True

    def acknowledge(self, arrivals: Sequence[Arrival]) -> None:
        """Add PUBACKs."""
        self._waiting.extend(arrivals)

    def take(self) -> Publication | Arrival | None:
        """The oldest; ``None`` where none waits."""
        if not self._waiting:
            return None
        item = self._waiting.popleft()
        if not isinstance(item, Arrival):
            self._went += len(item[1])
        return item
