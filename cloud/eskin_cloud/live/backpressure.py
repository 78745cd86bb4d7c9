"""Whether a reader keeps up, and how often a slow one is sent events."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from collections.abc import Callable

PATIENCE_S: Final = 0.2
"""A reader that takes longer to make room for more is slow."""
PROMPT_S: Final = 0.02
"""A slow reader stays slow until there is room at once."""
PAUSE_S: Final = 0.25
"""A slow reader is sent events this seldom, and half as often after each overflow."""
LONGEST_PAUSE_S: Final = 2.0
REST_S: Final = 1.0
"""A slow reader stays slow for so long at least."""
LONGEST_REST_S: Final = 60.0


class Backpressure:
    """One reader's.

    Between us and a slow reader are buffers of others, and what fills them grows old in them. So it
    is sent less than it could take. Their room lets it look fast for a moment: after a try that
    does not hold, the next one comes after twice the time.

    Args:
        clock: Monotonic seconds.

    Attributes:
        pause: Seconds between two sends.
    """

    def __init__(self, clock: Callable[[], float]) -> None:
        self.pause = 0.0
        self._clock = clock
        self._since = -LONGEST_REST_S
        self._rest = REST_S

    @property
    def slow(self) -> bool:
        """Whether it reads more slowly than there is to tell."""
        return self.pause > 0

    def note(self, took: float) -> None:
        """It took so many seconds until there was room for more."""
        now = self._clock()
        lasted = now - self._since
        if took > PATIENCE_S and self.slow:
            self.pause, self._since = min(2 * self.pause, LONGEST_PAUSE_S), now
        elif took > PATIENCE_S:
            self._rest = REST_S if lasted > self._rest else min(2 * self._rest, LONGEST_REST_S)
            self.pause, self._since = PAUSE_S, now
        elif self.slow and took <= PROMPT_S and lasted >= self._rest:
            self.pause, self._since = 0.0, now
