"""What a node signs when its gesture key was entered (docs/gesture-key.md)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Self

from eskin.errors import MessageError
from eskin.wire.messages.cbor_map import dump, load
from eskin.wire.messages.header import Kind

NONCE_BYTES: Final = 16
"""Of a challenge."""
_FIELDS: Final = frozenset(range(1, 5))


@dataclass(frozen=True, slots=True)
class Release:
    """A challenge that was answered.

    Attributes:
        node: Which node.
        nonce: The challenge's, 16 bytes.
        time: Earliest and latest UTC of the instant, ns, as the node knows it.
    """

    node: str
    nonce: bytes
    time: tuple[int, int]

    def encode(self) -> bytes:
        """Write as CBOR."""
        return dump({1: int(Kind.RELEASE), 2: self.node, 3: self.nonce, 4: list(self.time)})

    @classmethod
    def decode(cls, data: bytes) -> Self:
        """Read a release.

        Raises:
            MessageError: It is none.
        """
        fields = load(data)
        fields.only(_FIELDS)
        if fields.integer(1, 0, 255) != Kind.RELEASE:
            raise MessageError(f"field 1 is no release ({Kind.RELEASE:d})")
        nonce = fields.octets(3, NONCE_BYTES, NONCE_BYTES)
        return cls(fields.text(2, 63), nonce, fields.instants(4))
