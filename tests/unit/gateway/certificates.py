"""A cloud that registers nodes or rejects them, for tests."""

from __future__ import annotations

from typing import TYPE_CHECKING

from eskin_gateway.upstream.certificates_client import CertificatesClient

if TYPE_CHECKING:
    from collections.abc import Collection


class KnownNodes(CertificatesClient):
    """Registers certificates in memory.

    Attributes:
        rejected: Why nodes are rejected, by node.
        registered: Nodes in the order in which they were registered.
    """

    def __init__(self) -> None:
        self.rejected: dict[str, str] = {}
        self.registered: list[str] = []

    def has(self, node: str) -> bool:
        return bool(node)

    def register(self, nodes: Collection[str]) -> dict[str, str]:
        self.registered += sorted(nodes)
        return {node: self.rejected[node] for node in nodes if node in self.rejected}
