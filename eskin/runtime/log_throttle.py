"""Limit the log lines of each source, so that no peer fills a disk."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

BURST: Final = 10
WINDOW_S: Final = 10.0
_MOST_SOURCES: Final = 1000


class Source(NamedTuple):
    """What lines are counted together.

    Attributes:
        file: Of the statement that logs.
        line: Of the statement.
        key: What the statement tells apart, such as a gateway's name; mostly empty.
    """

    file: str
    line: int
    key: str = ""


@dataclass(slots=True)
class _Window:
    start: float
    count: int = 0


class LogThrottle:
    """Admits `BURST` lines of each source in `WINDOW_S` seconds. Not thread-safe.

    Beyond 1,000 sources in one window, keys are ignored: this bounds the memory.

    Args:
        clock: Monotonic seconds.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._windows: dict[Source, _Window] = {}

    def admit(self, source: Source) -> bool:
        """Count a line; gives whether it may be written. Call `ended` before."""
        if source not in self._windows and len(self._windows) >= _MOST_SOURCES:
            source = source._replace(key="")
        window = self._windows.setdefault(source, _Window(self._clock()))
        window.count += 1
        return window.count <= BURST

    def ended(self, *, early: bool = False) -> Iterator[tuple[Source, int]]:
        """Forget windows that are over; gives how many lines of each were suppressed, if any.

        Args:
            early: Also those that are not over yet, as the process ends.
        """
        now = self._clock()
        for source, window in list(self._windows.items()):
            if early or now >= window.start + WINDOW_S:
                del self._windows[source]
                if window.count > BURST:
                    yield source, window.count - BURST
