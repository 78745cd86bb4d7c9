"""What one commit of the spool holds."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from eskin_gateway.spool.node_state import NodeState


class Entry(NamedTuple):
    """One accepted message: the node's name, when it came (UTC ns), plaintext and position."""

    node: str
    received: int
    body: bytes
    boot: int | None = None
    sequence: int | None = None


class DeadLetter(NamedTuple):
    """A message that can go no further, when (UTC ns), and why.

    ``mark`` tells one from another where bodies do not: what is sealed twice differs.
    """

    at: int
    node: str
    reason: str
    body: bytes
    mark: bytes = b""


class Sender(NamedTuple):
    """A verified sender's certificates (DER), by thumbprint; ``expires`` in s since 1970."""

    thumbprint: bytes
    expires: int
    leaf: bytes
    issuer: bytes


@dataclass(slots=True)
class Batch:
    """All that becomes durable together, or not at all.

    Attributes:
        entries: Accepted messages, in order.
        dead: Authentic messages that nobody can read.
        nodes: What is remembered of each node that the batch touched.
        node_certificates: Certificates seen for the first time.
    """

    entries: list[Entry] = field(default_factory=list)
    dead: list[DeadLetter] = field(default_factory=list)
    nodes: dict[str, NodeState] = field(default_factory=dict)
    node_certificates: list[Sender] = field(default_factory=list)

    @property
    def size(self) -> int:
        """Bytes of the messages."""
        return sum(len(entry.body) for entry in self.entries)
