"""What one commit of the spool holds."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from eskin_gateway.spool.node_state import NodeState


class SpoolMessage(NamedTuple):
    """An accepted message.

    Attributes:
        node: The node's name.
        received: When the message was received, UTC ns.
        body: Plaintext, or a sealed message where it is biometric.
        boot: First part of its position.
        sequence: Second part.
        id: Its row; 0 before the commit.
    """

    node: str
    received: int
    body: bytes
    boot: int | None = None
    sequence: int | None = None
    id: int = 0


class DeadLetter(NamedTuple):
    """A message that cannot be decoded or stored.

    Attributes:
        time: When it became a dead letter, UTC ns.
        node: The node's name.
        reason: Why.
        body: Its bytes.
        fingerprint: Identifies its content, where the body was sealed with a fresh nonce.
    """

    time: int
    node: str
    reason: str
    body: bytes
    fingerprint: bytes = b""


class NodeCertificate(NamedTuple):
    """A verified certificate of a node and its issuer (DER).

    Attributes:
        thumbprint: SHA-256 of ``leaf``.
        expires: Seconds since 1970.
        leaf: The node's certificate.
        issuer: The certificate that signed it.
    """

    thumbprint: bytes
    expires: int
    leaf: bytes
    issuer: bytes


class Description(NamedTuple):
    """A patch or a layout of a node.

    Attributes:
        node: The node's name.
        hash: SHA-256 of ``body``.
        body: The message.
    """

    node: str
    hash: bytes
    body: bytes


@dataclass(slots=True)
class Batch:
    """What becomes durable in one transaction.

    Attributes:
        messages: Accepted messages, in order.
        dead_letters: Authentic messages that cannot be decoded.
        nodes: State of each node of the batch.
        certificates: Certificates that the spool does not have yet.
        descriptions: Descriptions that the spool does not have yet.
        evicted: Node and hash of descriptions to delete; those above are written afterwards.
        layouts: Node and hash of the layouts that ``messages`` name.
    """

    messages: list[SpoolMessage] = field(default_factory=list)
    dead_letters: list[DeadLetter] = field(default_factory=list)
    nodes: dict[str, NodeState] = field(default_factory=dict)
    certificates: list[NodeCertificate] = field(default_factory=list)
    descriptions: list[Description] = field(default_factory=list)
    evicted: list[tuple[str, bytes]] = field(default_factory=list)
    layouts: set[tuple[str, bytes]] = field(default_factory=set)

    @property
    def size(self) -> int:
        """Bytes of the messages."""
        return sum(len(message.body) for message in self.messages)
