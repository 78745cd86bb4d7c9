"""What is remembered of all nodes, as much of it in memory as was used lately."""

from __future__ import annotations

from collections import OrderedDict
from typing import TYPE_CHECKING

from eskin_gateway.spool.node_state import NodeState

if TYPE_CHECKING:
    from eskin_gateway.spool.spool import Spool


class NodeStates:
    """Node records, read from the spool on first use.

    Args:
        spool: Where they are durable.
        capacity: How many are kept in memory between batches.
    """

    def __init__(self, spool: Spool, *, capacity: int = 4096) -> None:
        self._spool = spool
        self._capacity = capacity
        self._kept: OrderedDict[str, NodeState] = OrderedDict()

    def __getitem__(self, node: str) -> NodeState:
        record = self._kept.get(node)
        if record is None:
            record = self._kept[node] = self._spool.node(node) or NodeState()
        return record

    def committed(self, nodes: dict[str, NodeState]) -> None:
        """The records of a batch are durable now; what was not used lately may go."""
        for node in nodes:
            self._kept.move_to_end(node)
        while len(self._kept) > self._capacity:
            self._kept.popitem(last=False)

    def forget(self) -> None:
        """Drop what is in memory: it may hold what never became durable."""
        self._kept.clear()
