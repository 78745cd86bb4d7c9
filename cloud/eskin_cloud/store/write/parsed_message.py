"""One message of a batch, read and checked, before the store is asked anything."""

from __future__ import annotations

import functools
from typing import TYPE_CHECKING, Final, NamedTuple

from eskin.errors import IdentityError, MessageError
from eskin.identity import IdentityKind
from eskin.privacy import SealedMessage, is_biometric, is_impersonal, is_sealed
from eskin.runtime.digest import digest
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

_AT_ONCE: Final = 64
"""Messages of one look: as many as a processor's cache holds."""
IN_THE_CLEAR: Final = (
    "it tells of a person and is not sealed, so that none of it is kept here; let a gateway that "
    "seals bring it"
)
UNREAD: Final = "it cannot be read"
WITHHELD: Final = "; of its {} bytes none is kept here, as they may tell of a person"


class ParsedMessage(NamedTuple):
    """One message of a batch, already read.

    Attributes:
        node: Who said it, as the gateway vouches.
        data: Its bytes.
        message: What they say; ``None`` if they say nothing.
        reason: Why not.
        kept: A block as the store keeps it, where that is shorter than its bytes.
        digest: Of its bytes as the store keeps them, or of what each sealing of it shares: by it
            the store tells it from another message under its number. Empty where there is none.
    """

    node: str
    data: bytes
    message: Summary | SealedMessage | None
    reason: str | None = None
    kept: bytes | None = None
    digest: bytes = b""

    @classmethod
    def read(cls, node: str, data: bytes) -> ParsedMessage:
        """Read a message; a poor one becomes an item with a reason."""
        return cls.read_all([(node, data)])[0]

    @classmethod
    def read_all(cls, said: Sequence[tuple[str, bytes]]) -> list[ParsedMessage]:
        """Read messages, each with its node: other threads wait for no look at samples."""
        items: list[ParsedMessage] = []
        for at in range(0, len(said), _AT_ONCE):
            some = said[at : at + _AT_ONCE]
            joined = Joined.of([data for _, data in some])
            found = zip(some, scan_all(joined), compress_all(joined), strict=True)
            items += [cls._of(node, data, block, kept) for (node, data), block, kept in found]
        return items

    @classmethod
    def _of(
        cls, node: str, data: bytes, block: BlockSummary | None, kept: bytes | None
    ) -> ParsedMessage:
        try:
            _require_node(node)
            if block is None and is_sealed(data):
                sealed = _require_biometric(SealedMessage.decode(data))
                return cls(node, data, sealed, digest=digest(sealed.said))
            message = decode_summary(data) if block is None else block
            if isinstance(message, BlockSummary | Peak) and is_biometric(message.channel):
                return cls.refused(node, b"", IN_THE_CLEAR)
            _require_storable(message)
        except MessageError as error:
            return cls.unread(node, data, str(error), instead=UNREAD)
        except IdentityError as error:
            return cls.unread(node, data, str(error))
        return cls(node, data, message, None, kept, digest(kept or data))

    @classmethod
    def unread(
        cls, node: str, data: bytes, reason: str, *, instead: str | None = None
    ) -> ParsedMessage:
        """An item that cannot be used; of what may tell of a person its size alone is kept.

        Args:
            node: Who said it.
            data: All of it.
            reason: Why it cannot be used.
            instead: What is said of what may tell of a person, where the reason may quote it.
        """
        if is_impersonal(data):
            return cls.refused(node, data[:MOST_BYTES], reason)
        return cls.refused(node, b"", (instead or reason) + WITHHELD.format(len(data)))

    @classmethod
    def refused(cls, node: str, data: bytes, reason: str) -> ParsedMessage:
        """An item that says nothing."""
        shown = "".join(letter for letter in node[:NODE_LENGTH] if letter.isprintable())
        return cls(shown, data, None, reason)


def is_node(name: str) -> bool:
    """Whether a text may name a node."""
    try:
        _require_node(name)
    except IdentityError:
        return False
    return True


@functools.lru_cache(4096)
def _require_node(name: str) -> None:
    IdentityKind.NODE.require_name(name)


def _require_biometric(message: SealedMessage) -> SealedMessage:
    if message.kind is Kind.VEILED or not is_biometric(message.channel):
        raise MessageError(f"channel {message.channel} is not biometric; it is not to be sealed")
    return message


def _require_storable(message: Summary) -> None:
    if isinstance(message, BlockSummary) and message.time[1] + message.span > MOST_MOMENT:
        raise MessageError(
            f"last sample lies after the year 2262: first at {message.time[1]} ns, "
            f"{message.n} samples of {message.dt} ns"
        )
