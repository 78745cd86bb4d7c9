"""The commands that the cloud wants delivered now, at most one for each node."""

from __future__ import annotations

from dataclasses import dataclass
from threading import Lock
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable


@dataclass(slots=True)
class _Held:
    id: int
    signed: bytes
    sent: float | None = None
    answered: bool = False


class PendingCommands:
    """Shared by the thread that fetches commands and the one that publishes them.

    Nothing of it is durable: after a start the cloud gives all of it again.

    Args:
        resend_s: Seconds after which a command is published again.
    """

    def __init__(self, resend_s: float) -> None:
        self._resend = resend_s
        self._lock = Lock()
        self._held: dict[str, _Held] = {}
        self._withdrawn: set[str] = set()

    def change(
        self, give: Iterable[tuple[str, int, bytes]], drop: Iterable[tuple[str, int]]
    ) -> None:
        """Take over what the cloud says."""
        with self._lock:
            for node, number in drop:
                held = self._held.get(node)
                if held is not None and held.id == number:
                    del self._held[node]
                    self._withdrawn.add(node)
            for node, number, signed in give:
                self._held[node] = _Held(number, signed)

    def held(self) -> list[tuple[str, int, bool]]:
        """Node, id, and whether it was published."""
        with self._lock:
            return [(node, held.id, held.sent is not None) for node, held in self._held.items()]

    def due(self, now: float) -> list[tuple[str, int, bytes]]:
        """Node, id and bytes of what should be published now.

        Args:
            now: Monotonic seconds.
        """
        with self._lock:
            return [
                (node, held.id, held.signed)
                for node, held in self._held.items()
                if not held.answered and (held.sent is None or now >= held.sent + self._resend)
            ]

    def sent(self, node: str, number: int, now: float) -> None:
        """A command was published."""
        with self._lock:
            held = self._held.get(node)
            if held is not None and held.id == number:
                held.sent = now
            self._withdrawn.discard(node)

    def answered(self, node: str, number: int) -> None:
        """A node has said what became of a command, and of all before."""
        with self._lock:
            held = self._held.get(node)
            if held is not None and held.id <= number and not held.answered:
                held.answered = True
                self._withdrawn.add(node)

    def withdrawn(self) -> list[str]:
        """Nodes whose last command the broker should keep no more; told once."""
        with self._lock:
            nodes, self._withdrawn = sorted(self._withdrawn), set()
            return nodes
