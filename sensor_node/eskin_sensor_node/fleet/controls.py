"""What can be set of a fleet's member: for that, it leaves its cohort."""

from __future__ import annotations

from typing import TYPE_CHECKING

from eskin_sensor_node.node.controls import NodeControls

if TYPE_CHECKING:
    from eskin.wire.messages.command_schema import Arguments, State
    from eskin_sensor_node.fleet.shard import Shard


class MemberControls:
    """A single node's controls; a member does what they say alone, and joins those set likewise.

    Args:
        shard: With whom the member samples.
        row: Its place there.
    """

    __slots__ = ("_row", "_shard")

    def __init__(self, shard: Shard, row: int) -> None:
        self._shard = shard
        self._row = row

    def apply(self, name: str, arguments: Arguments) -> State:
        """As `eskin_sensor_node.node.controls.NodeControls.apply`."""
        node = self._shard.singles.get(self._row) or self._shard.apart(self._row)
        state = NodeControls(node).apply(name, arguments)
        self._shard.part(self._row, node)
        return state

    def restore(self, state: State) -> State:
        """As `node.controls.NodeControls.restore`; as designed, it stays in its cohort."""
        designed, node = self._shard.designed, self._shard.singles.get(self._row)
        if node is None:
            if state in ({}, designed):
                return designed
            node = self._shard.apart(self._row)
            self._shard.part(self._row, node)
        return NodeControls(node).restore(state)
