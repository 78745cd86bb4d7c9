"""Parse and check messages of a batch, before they reach the store."""

from __future__ import annotations

import functools
from typing import Final, NamedTuple, TypeAlias

from eskin.errors import IdentityError, MessageError
from eskin.identity import IdentityKind
from eskin.privacy import SealedMessage, is_not_biometric, is_sealed
from eskin.runtime.digest import digest
from eskin.wire.frames import EncodedFrame, Statements
from eskin.wire.messages import Result, Status, read_message
from eskin.wire.messages.cbor_map import MOST_BYTES, load
from eskin.wire.messages.header import Kind
from eskin_cloud.store.schema.node_key import NODE_LENGTH

Message: TypeAlias = EncodedFrame | Statements | Status | Result | SealedMessage
"""Whatever has a place in a node's sequence."""

_FRAME: Final = bytes((1, Kind.FRAME))
UNSEALED: Final = (
    "a biometric channel must be sealed; nothing of this message is kept: send it through a "
    "gateway that seals"
)
UNREADABLE: Final = "the message cannot be decoded"
WITHHELD: Final = "; its {} bytes are not kept, as they may be biometric"


class ParsedMessage(NamedTuple):
    """A parsed message.

    Attributes:
        node: Its node, as the gateway verified.
        data: Its bytes.
        message: The decoded message; ``None`` if it is rejected.
        reason: Why it is rejected.
        digest: Digest of the bytes, or of what all sealings of the message share; it distinguishes
            duplicates from conflicts. Empty if there is none.
    """

    node: str
    data: bytes
    message: Message | None
    reason: str | None = None
    digest: bytes = b""

    @classmethod
    def parse(cls, node: str, data: bytes) -> ParsedMessage:
        """Parse a message; an invalid one has a reason instead of a message."""
        try:
            _require_node(node)
            if is_sealed(data):
                sealed = _require_placed(SealedMessage.decode(data))
                return cls(node, data, sealed, digest=digest(sealed.shared))
            message = _decode(data)
        except MessageError as error:
            return cls.unreadable(node, data, str(error), instead=UNREADABLE)
        except IdentityError as error:
            return cls.unreadable(node, data, str(error))
        return cls(node, data, message, digest=digest(data))

    @classmethod
    def unreadable(
        cls, node: str, data: bytes, reason: str, *, instead: str | None = None
    ) -> ParsedMessage:
        """A rejected message; only the size is kept of one that may be biometric.

        Args:
            node: Its node.
            data: Its bytes.
            reason: Why it is rejected.
            instead: The reason for one that may be biometric, where ``reason`` may quote it.
        """
        if is_not_biometric(data):
            return cls.rejected(node, data[:MOST_BYTES], reason)
        return cls.rejected(node, b"", (instead or reason) + WITHHELD.format(len(data)))

    @classmethod
    def rejected(cls, node: str, data: bytes, reason: str) -> ParsedMessage:
        """A rejected message."""
        shown = "".join(letter for letter in node[:NODE_LENGTH] if letter.isprintable())
        return cls(shown, data, None, reason)


def is_node(name: str) -> bool:
    """Whether a text is a valid node name."""
    try:
        _require_node(name)
    except IdentityError:
        return False
    return True


@functools.lru_cache(4096)
def _require_node(name: str) -> None:
    IdentityKind.NODE.require_name(name)


def _decode(data: bytes) -> EncodedFrame | Statements | Status | Result:
    # Deterministic CBOR of a map with less than 24 fields begins with its head, and field 1.
    if data[1:3] == _FRAME:
        return EncodedFrame.decode(data)
    fields = load(data)
    if fields.integer(1, 0, 255) == Kind.STATEMENTS:
        return Statements.read(fields)
    return read_message(fields)


def _require_placed(message: SealedMessage) -> SealedMessage:
    """Check that a sealed message is read by a layout, which states whether it is biometric."""
    if message.layout is None:
        raise MessageError("only frames and statements are sealed")
    return message
