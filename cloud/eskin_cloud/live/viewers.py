"""Which nodes are viewed: these should send short blocks."""

from __future__ import annotations

import time
from collections import Counter
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator


class Viewers:
    """Counts who looks at what; on the event loop only.

    Streams of chosen nodes look at these; a stream of everything looks at each node of which
    something comes. So many nodes are watched for either reason, those that came first.

    Args:
        most: Nodes that are watched at once, for each of the two reasons.
        lasting: Seconds for which one look is good.
        clock: Monotonic seconds.
    """

    def __init__(
        self, *, most: int, lasting: float, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self.lasting = lasting
        self._clock = clock
        self._streams: Counter[str] = Counter()
        self._everything = 0
        self._elsewhere: dict[str, float] = {}
        self._chosen, self._others = _Places(most, lasting), _Places(most, lasting)

    @property
    def nodes(self) -> list[str]:
        """What streams of this process have chosen."""
        return list(self._streams)

    @contextmanager
    def looking(self, nodes: Iterable[str]) -> Iterator[None]:
        """Look at nodes; at everything where none is named."""
        chosen = Counter(set(nodes))
        self._streams += chosen
        self._everything += not chosen
        try:
            yield
        finally:
            self._streams -= chosen
            self._everything -= not chosen

    def hear(self, nodes: Iterable[str]) -> None:
        """Another process says what streams have chosen there."""
        self._elsewhere |= dict.fromkeys(nodes, self._clock() + self.lasting)

    def watched(self, nodes: Iterable[str]) -> list[str]:
        """The viewed ones of some nodes."""
        now = self._clock()
        self._elsewhere = {node: until for node, until in self._elsewhere.items() if until > now}
        return [node for node in nodes if self._is_watched(node, now)]

    def _is_watched(self, node: str, now: float) -> bool:
        if node in self._streams or node in self._elsewhere:
            return self._chosen.give(node, now)
        return self._everything > 0 and self._others.give(node, now)


class _Places:
    """So many places, each held for a while."""

    def __init__(self, most: int, lasting: float) -> None:
        self._most = most
        self._lasting = lasting
        self._held: dict[str, float] = {}

    def give(self, node: str, now: float) -> bool:
        """Give a node a place, or let it keep its own, if there is one."""
        if node not in self._held and len(self._held) >= self._most:
            self._held = {node: until for node, until in self._held.items() if until > now}
            if len(self._held) >= self._most:
                return False
        self._held[node] = now + self._lasting
        return True
