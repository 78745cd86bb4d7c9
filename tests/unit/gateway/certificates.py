"""A cloud that knows nodes, or refuses them, for tests."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Collection


class KnownNodes:
    """The in-memory twin of the way by which certificates are presented.

    Attributes:
        refused: Why nodes are refused.
        presented: Nodes in the order in which they were presented.
    """

    def __init__(self) -> None:
        self.refused: dict[str, str] = {}
        self.presented: list[str] = []

    def has(self, node: str) -> bool:
        return bool(node)

    def present(self, nodes: Collection[str]) -> dict[str, str]:
        self.presented += sorted(nodes)
        return {node: self.refused[node] for node in nodes if node in self.refused}
