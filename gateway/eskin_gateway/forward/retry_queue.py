"""Messages that the cloud fails at, each one alone, while it takes others."""

from __future__ import annotations

import logging
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from eskin_gateway.spool.spool import Stored

log = logging.getLogger(__name__)

_MOST: Final = 16
"""So many failures one after another, with nothing taken between them, are the cloud's."""
_LONGEST_PAUSE_S: Final = 60.0
_MOST_DOUBLINGS: Final = 6
"""Of the first pause; more of them, after a day or so, would be no float any more."""


@dataclass
class _Held:
    """One message that waits beside the rest.

    Attributes:
        message: As it stays in the spool.
        refused: How often it was tried in vain although the cloud had taken others.
        due: When it is tried again, in the clock's seconds; ``None`` while it is not known
            whether the cloud takes anything.
    """

    message: Stored
    refused: int = 0
    due: float | None = None


class RetryQueue:
    """Keeps what the cloud fails at out of the way of what it takes; nothing of it is given up.

    That the cloud failed at one message alone says little: the cloud may fail at all of them. It is
    the message's fault once the cloud takes another one; until then, it is only left out. What is
    held stays in the spool; after a restart it is found again in the same way.

    Args:
        clock: Seconds that never go back.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._held: dict[int, _Held] = {}

    @property
    def ids(self) -> tuple[int, ...]:
        """Which messages of the spool are held."""
        return tuple(self._held)

    def __len__(self) -> int:
        return len(self._held)

    @property
    def fault(self) -> str | None:
        """What is to be told of it; ``None`` where nothing is held."""
        if not self._held:
            return None
        one = next(iter(self._held.values())).message
        return (
            f"the cloud fails at {len(self._held)} message(s), one of {one.node}, while it takes "
            "others: they stay in the spool and are tried again; its log tells why"
        )

    def due(self) -> Stored | None:
        """One that is to be tried again now, alone."""
        now = self._clock()
        for held in self._held.values():
            if held.due is not None and held.due <= now:
                return held.message
        return None

    def hold(self, message: Stored) -> bool:
        """The cloud failed at a message alone.

        Returns:
            Whether the others are to be tried without it.
        """
        held = self._held.get(message.id)
        if held is None:
            if len(self._held) >= _MOST:
                return False
            self._held[message.id] = _Held(message)
        else:
            self.put_off(message)
        return True

    def put_off(self, message: Stored) -> None:
        """Try one that is at fault again after a longer pause, and after the others."""
        held = self._held.get(message.id)
        if held is None or held.due is None:
            return
        self._held[message.id] = self._held.pop(message.id)
        held.refused = min(held.refused + 1, _MOST_DOUBLINGS)
        held.due = self._clock() + min(2.0**held.refused, _LONGEST_PAUSE_S)

    def forget(self, message: Stored) -> None:
        """It has left the spool."""
        self._held.pop(message.id, None)

    def release_suspects(self) -> bool:
        """Leave out only what is at fault; gives whether anything else was left out."""
        suspects = [number for number, held in self._held.items() if held.due is None]
        for number in suspects:
            del self._held[number]
        return bool(suspects)

    def taken(self, messages: Sequence[Stored]) -> None:
        """The cloud took messages: now those that it had failed at are tried once more."""
        for message in messages:
            self.forget(message)
        for held in self._held.values():
            if held.due is None:
                log.warning("left out, as the cloud fails at it: node=%s", held.message.node)
                held.due = self._clock()
