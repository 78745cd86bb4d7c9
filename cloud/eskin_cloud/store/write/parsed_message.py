"""Parse and check messages of a batch, before they reach the store."""

from __future__ import annotations

import functools
from typing import TYPE_CHECKING, Final, NamedTuple, TypeAlias

from eskin.errors import IdentityError, MessageError
from eskin.identity import IdentityKind
from eskin.privacy import SealedMessage, is_biometric, is_not_biometric, is_sealed
from eskin.runtime.digest import digest
from eskin.wire.frames import FrameSummary, Statements
from eskin.wire.messages import BlockSummary, Peak, Summary, decode_summary
from eskin.wire.messages.cbor_map import MOST_BYTES
from eskin.wire.messages.compression import compress_all
from eskin.wire.messages.concatenated import Joined
from eskin.wire.messages.fast_decode import scan_all
from eskin.wire.messages.header import Kind
from eskin.wire.timestamp import MOST_MOMENT
from eskin_cloud.store.schema.tables import NODE_LENGTH

if TYPE_CHECKING:
    from collections.abc import Sequence

Message: TypeAlias = Summary | SealedMessage | FrameSummary | Statements
"""Whatever has a place in a node's sequence."""

_AT_ONCE: Final = 64
"""Messages that are parsed at once: they fit a processor's cache."""
_FRAME: Final = bytes((1, Kind.FRAME))
_STATEMENTS: Final = bytes((1, Kind.STATEMENTS))
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
        compressed: A block compressed for the store, if that is shorter.
        digest: Digest of the stored bytes, or of what all sealings of the message share; it tells
            duplicates from conflicts. Empty if there is none.
    """

    node: str
    data: bytes
    message: Message | None
    reason: str | None = None
    compressed: bytes | None = None
    digest: bytes = b""

    @classmethod
    def parse(cls, node: str, data: bytes) -> ParsedMessage:
        """Parse a message; an invalid one has a reason instead of a message."""
        return cls.parse_all([(node, data)])[0]

    @classmethod
    def parse_all(cls, received: Sequence[tuple[str, bytes]]) -> list[ParsedMessage]:
        """Parse messages, each with its node."""
        items: list[ParsedMessage] = []
        for at in range(0, len(received), _AT_ONCE):
            some = received[at : at + _AT_ONCE]
            joined = Joined.of([data for _, data in some])
            found = zip(some, scan_all(joined), compress_all(joined), strict=True)
            items += [
                cls._of(node, data, block, compressed) for (node, data), block, compressed in found
            ]
        return items

    @classmethod
    def _of(
        cls, node: str, data: bytes, block: BlockSummary | None, compressed: bytes | None
    ) -> ParsedMessage:
        try:
            _require_node(node)
            if block is None and is_sealed(data):
                sealed = _require_biometric(SealedMessage.decode(data))
                return cls(node, data, sealed, digest=digest(sealed.said))
            message = _decode(data) if block is None else block
            if isinstance(message, BlockSummary | Peak) and is_biometric(message.channel):
                return cls.rejected(node, b"", UNSEALED)
            _require_storable(message)
        except MessageError as error:
            return cls.unreadable(node, data, str(error), instead=UNREADABLE)
        except IdentityError as error:
            return cls.unreadable(node, data, str(error))
        return cls(node, data, message, None, compressed, digest(compressed or data))

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


def _decode(data: bytes) -> Summary | FrameSummary | Statements:
    # Deterministic CBOR of a map with less than 24 fields begins with its head, and field 1.
    if data[1:3] == _FRAME:
        return FrameSummary.decode(data)
    if data[1:3] == _STATEMENTS:
        return Statements.decode(data)
    return decode_summary(data)


def _require_biometric(message: SealedMessage) -> SealedMessage:
    if message.kind is Kind.ENCRYPTED or not is_biometric(message.channel):
        raise MessageError(f"channel {message.channel} is not biometric; do not seal it")
    return message


def _require_storable(message: Message) -> None:
    if isinstance(message, BlockSummary) and message.time[1] + message.span > MOST_MOMENT:
        raise MessageError(
            f"last sample lies after the year 2262: first at {message.time[1]} ns, "
            f"{message.n} samples of {message.dt} ns"
        )
