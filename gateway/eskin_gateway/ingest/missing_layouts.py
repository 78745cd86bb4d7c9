"""Which layouts nodes' messages wait for, and since when."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, NamedTuple

from eskin.wire.messages.acknowledgement import MOST_WANTED

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

MOST_LAYOUTS: Final = 16
"""Layouts that messages of one node may wait for at the same time."""
_ASK_S: Final = 1.0
"""Seconds before the same is asked for again."""
_SILENCE_S: Final = 60.0
"""Seconds without a message after which the time of waiting begins anew: the node was away."""


@dataclass(slots=True)
class _Missing:
    since: float
    seen: float
    asked: float = float("-inf")


class Request(NamedTuple):
    """What becomes of a message that cannot be read yet.

    Attributes:
        hashes: What to ask the node for now.
        fault: Why the message need not wait any longer; ``None`` while it must.
    """

    hashes: Sequence[bytes]
    fault: str | None = None


class MissingLayouts:
    """Asks nodes for layouts, for which their messages wait a limited time. Not thread-safe.

    Args:
        longest_s: Seconds for which messages wait for a layout.
        clock: Monotonic seconds.
    """

    def __init__(self, longest_s: float, clock: Callable[[], float] = time.monotonic) -> None:
        self._longest_s = longest_s
        self._clock = clock
        self._missing: dict[str, dict[bytes, _Missing]] = {}

    def wait(self, node: str, layout: bytes, hashes: Sequence[bytes]) -> Request:
        """Note a message that cannot be read yet.

        Args:
            node: The node.
            layout: What the message is read by.
            hashes: What is missing of it.
        """
        now = self._clock()
        of_node = self._missing.setdefault(node, {})
        for silent in [k for k, each in of_node.items() if now > each.seen + _SILENCE_S]:
            del of_node[silent]
        if layout not in of_node and len(of_node) >= MOST_LAYOUTS:
            return Request(
                (), f"the node does not send its layout {layout.hex()}, nor {MOST_LAYOUTS} others"
            )
        missing = of_node.setdefault(layout, _Missing(now, now))
        missing.seen = now
        is_due = now >= missing.asked + _ASK_S
        if is_due:
            missing.asked = now
        fault = None
        if now >= missing.since + self._longest_s:
            fault = (
                f"the node does not send its layout {layout.hex()}: for {now - missing.since:.0f} "
                f"s it was asked for {len(hashes)} descriptions, the first {hashes[0].hex()}"
            )
        return Request(hashes[:MOST_WANTED] if is_due else (), fault)

    def found(self, node: str, layout: bytes) -> None:
        """Note that a layout is complete."""
        of_node = self._missing.get(node)
        if of_node is not None:
            of_node.pop(layout, None)
            if not of_node:
                del self._missing[node]
