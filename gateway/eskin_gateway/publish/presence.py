"""Which nodes are there: whoever was heard lately."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from eskin.wire.messages import Status
from eskin_gateway.publish import public_payloads

if TYPE_CHECKING:
    from collections.abc import Iterator

    from eskin_gateway.spool.spool import Spool


@dataclass(slots=True)
class _Node:
    heard: float
    status: Status | None
    online: bool | None


class Presence:
    """Decides from silence, and says so on the public status topics.

    Args:
        silence_s: Seconds of silence after which a node is offline.
    """

    def __init__(self, silence_s: float) -> None:
        self._silence = silence_s
        self._nodes: dict[str, _Node] = {}

    def restore(self, spool: Spool, now: float) -> None:
        """Take over the nodes of an earlier start, whose public status may still say online."""
        for name in spool.nodes():
            record = spool.node(name)
            if record is not None and record.status is not None:
                self._nodes[name] = _Node(now, Status.decode(record.status), None)

    def heard(
        self, name: str, status: Status | None, *, live: bool, now: float
    ) -> Iterator[tuple[str, bytes, bool]]:
        """A node's message came; gives what there is to publish.

        Args:
            name: The node.
            status: The message, where it is a status.
            live: Whether it came from the node just now, not from the broker's memory.
            now: Monotonic seconds.
        """
        node = self._nodes.setdefault(name, _Node(now, None, None))
        came_back = live and node.online is not True
        if live:
            node.heard, node.online = now, True
        if status is not None:
            node.status = status
        if came_back or (status is not None and node.online is not None):
            yield from self._say(name, node)

    def silent(self, now: float) -> Iterator[tuple[str, bytes, bool]]:
        """Gives what there is to publish of nodes that fell silent."""
        for name, node in self._nodes.items():
            if node.online is not False and now >= node.heard + self._silence:
                node.online = False
                yield from self._say(name, node)

    def excuse(self, now: float) -> None:
        """Nobody could be heard until now, so silence counts from now."""
        for node in self._nodes.values():
            node.heard = now

    @property
    def online(self) -> int:
        """How many nodes are there."""
        return sum(node.online is True for node in list(self._nodes.values()))

    def _say(self, name: str, node: _Node) -> Iterator[tuple[str, bytes, bool]]:
        if node.status is not None:
            topic, body = public_payloads.status(name, node.status, online=node.online is True)
            yield topic, body, True
