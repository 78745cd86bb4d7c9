"""A cloud that takes descriptions or rejects them, for tests."""

from __future__ import annotations

from typing import TYPE_CHECKING

from eskin_gateway.upstream.descriptions_client import DescriptionsClient, Posted

if TYPE_CHECKING:
    from collections.abc import Sequence


class KnownDescriptions(DescriptionsClient):
    """Takes descriptions in memory.

    Attributes:
        rejected: Hashes that are rejected.
        unknown: Nodes that are not registered.
        posted: Node and hash of what was posted, in order.
    """

    def __init__(self) -> None:
        self.rejected: set[bytes] = set()
        self.unknown: set[str] = set()
        self.posted: list[tuple[str, bytes]] = []

    def post(self, wanted: Sequence[tuple[str, bytes]]) -> dict[tuple[str, bytes], Posted]:
        self.posted += wanted
        return {key: self._answer(*key) for key in wanted}

    def _answer(self, node: str, name: bytes) -> Posted:
        if node in self.unknown:
            return Posted("unknown_node", "present it")
        if name in self.rejected:
            return Posted("rejected", "not wanted")
        return Posted("stored", None)
