"""Commands that the cloud wants delivered, at most one for each node."""

from __future__ import annotations

from dataclasses import dataclass
from threading import Lock
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable


@dataclass(slots=True)
class _Command:
    id: int
    signed: bytes
    published: float | None = None
    answered: bool = False


class PendingCommands:
    """Shared by the thread that fetches commands and the one that publishes them.

    Nothing of it is durable: after a restart the cloud sends all of it again.

    Args:
        resend_s: Seconds after which a command is published again.
    """

    def __init__(self, resend_s: float) -> None:
        self._resend_s = resend_s
        self._lock = Lock()
        self._commands: dict[str, _Command] = {}
        self._withdrawn: set[str] = set()

    def change(
        self, give: Iterable[tuple[str, int, bytes]], drop: Iterable[tuple[str, int]]
    ) -> None:
        """Apply changes of the cloud."""
        with self._lock:
            for node, number in drop:
                command = self._commands.get(node)
                if command is not None and command.id == number:
                    del self._commands[node]
                    self._withdrawn.add(node)
            for node, number, signed in give:
                self._commands[node] = _Command(number, signed)

    def pending(self) -> list[tuple[str, int, bool]]:
        """Node, id, and whether it was published."""
        with self._lock:
            return [(n, c.id, c.published is not None) for n, c in self._commands.items()]

    def due(self, now: float) -> list[tuple[str, int, bytes]]:
        """Node, id and bytes of commands to publish now.

        Args:
            now: Monotonic seconds.
        """
        with self._lock:
            return [
                (node, command.id, command.signed)
                for node, command in self._commands.items()
                if not command.answered
                and (command.published is None or now >= command.published + self._resend_s)
            ]

    def published(self, node: str, number: int, now: float) -> None:
        """Note that a command was published."""
        with self._lock:
            command = self._commands.get(node)
            if command is not None and command.id == number:
                command.published = now
            self._withdrawn.discard(node)

    def answered(self, node: str, number: int) -> None:
        """Note the result of a command, which also ends all earlier ones."""
        with self._lock:
            command = self._commands.get(node)
            if command is not None and command.id <= number and not command.answered:
                command.answered = True
                self._withdrawn.add(node)

    def take_withdrawn(self) -> list[str]:
        """Nodes whose retained command must be cleared, each once."""
        with self._lock:
            nodes, self._withdrawn = sorted(self._withdrawn), set()
            return nodes
