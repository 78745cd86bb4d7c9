"""What can be set of a fleet's member: for that, it leaves its cohort."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sensor_node.controls import NodeControls

if TYPE_CHECKING:
    from eskin.messages.vocabulary import Arguments, State
    from sensor_node.fleet.squad import Squad


class MemberControls:
    """A single node's controls; a member does what they say alone, and joins those set likewise.

    Args:
        squad: With whom the member samples.
        row: Its place there.
    """

    __slots__ = ("_row", "_squad")

    def __init__(self, squad: Squad, row: int) -> None:
        self._squad = squad
        self._row = row

    def apply(self, name: str, arguments: Arguments) -> State:
        """As `sensor_node.controls.NodeControls.apply`."""
        node = self._squad.soloists.get(self._row) or self._squad.apart(self._row)
        state = NodeControls(node).apply(name, arguments)
        self._squad.part(self._row, node)
        return state

    def restore(self, state: State) -> State:
        """As `sensor_node.controls.NodeControls.restore`; as designed, it stays in its cohort."""
        designed, node = self._squad.designed, self._squad.soloists.get(self._row)
        if node is None:
            if state in ({}, designed):
                return designed
            node = self._squad.apart(self._row)
            self._squad.part(self._row, node)
        return NodeControls(node).restore(state)
