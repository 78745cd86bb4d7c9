"""Which nodes are online, by the time since their last message."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from eskin.wire.messages import Status
from eskin_gateway.publish import public_payloads

if TYPE_CHECKING:
    from collections.abc import Iterator

    from eskin_gateway.mqtt.transport import Publication
    from eskin_gateway.spool.spool import Spool


@dataclass(slots=True)
class _Node:
    last_seen: float
    status: Status | None
    online: bool | None


class Presence:
    """Tracks which nodes are online, and publishes changes on the public status topics.

    Args:
        offline_after_s: Seconds without a message after which a node is offline.
    """

    def __init__(self, offline_after_s: float) -> None:
        self._offline_after_s = offline_after_s
        self._nodes: dict[str, _Node] = {}

    def restore(self, spool: Spool, now: float) -> None:
        """Add the nodes of the last run, whose public status may still be online."""
        for name, status in latest_statuses(spool).items():
            self._nodes[name] = _Node(now, status, None)

    def update(
        self, name: str, status: Status | None, *, live: bool, now: float
    ) -> Iterator[Publication]:
        """Note a message of a node, and publish changes.

        Args:
            name: The node.
            status: The message, if it is a status.
            live: Whether the node sent it now, and the broker had not retained it.
            now: Monotonic seconds.
        """
        node = self._nodes.setdefault(name, _Node(now, None, None))
        came_online = live and node.online is not True
        if live:
            node.last_seen, node.online = now, True
        if status is not None:
            node.status = status
        if came_online or (status is not None and node.online is not None):
            yield from _publication(name, node)

    def expire(self, now: float) -> Iterator[Publication]:
        """Publish the nodes that went offline."""
        for name, node in self._nodes.items():
            if node.online is not False and now >= node.last_seen + self._offline_after_s:
                node.online = False
                yield from _publication(name, node)

    def restart_timers(self, now: float) -> None:
        """Restart all timers: no message could arrive until now."""
        for node in self._nodes.values():
            node.last_seen = now

    @property
    def online(self) -> int:
        """Nodes that are online."""
        return sum(node.online is True for node in list(self._nodes.values()))


def latest_statuses(spool: Spool) -> dict[str, Status]:
    """Latest status of each node in the spool."""
    states = ((name, spool.node(name)) for name in spool.nodes())
    return {
        name: Status.decode(state.status)
        for name, state in states
        if state is not None and state.status is not None
    }


def _publication(name: str, node: _Node) -> Iterator[Publication]:
    if node.status is not None:
        yield public_payloads.status(name, node.status, online=node.online is True)
