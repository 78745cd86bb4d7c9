"""A biometric message, encrypted under its subject's key.

In the clear stands what is needed to keep it once, to find it again, and to forget it in time:
position, kind, pseudonym, the whole minutes in which it lies, the layout, and of a frame its page.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Self, TypeAlias

import cbor2

from eskin.errors import MessageError
from eskin.privacy.subject import is_pseudonym
from eskin.wire.frames.content_hash import HASH_BYTES
from eskin.wire.frames.layout import MOST_PAGES
from eskin.wire.messages.cbor_map import (
    MOST_BYTES,
    MOST_COUNT,
    dump,
    integer,
    load,
    octets,
    pair,
)
from eskin.wire.messages.header import Kind, Position, position_fields, read_position
from eskin.wire.timestamp import MOST_INSTANT

if TYPE_CHECKING:
    from eskin.wire.messages.cbor_map import Fields

MINUTE: Final = 60 * 10**9
SALT_BYTES: Final = 16
MAC_BYTES: Final = 8
UNREAD: Final = "unread.unread"
"""The place of what could not be read."""
Place: TypeAlias = str | bytes | tuple[bytes, int]
"""Where messages are found again: a layout's hash, such a hash and a page, or `UNREAD`."""
_KINDS: Final = frozenset({Kind.FRAME, Kind.STATEMENTS, Kind.ENCRYPTED})
_FIELDS: Final = frozenset(range(1, 12))
_BEGINNING: Final = bytes([0xA0 | len(_FIELDS), 1, Kind.ENCRYPTED])


@dataclass(frozen=True, slots=True)
class SealedMessage:
    """A sealed frame, or sealed statements.

    Attributes:
        position: Boot and sequence.
        place: Layout and page of a frame; the layout of statements; `UNREAD` of other bytes.
        kind: What is inside: such a message, or (``ENCRYPTED``) bytes that are none.
        subject: Whose: a pseudonym.
        time: UTC ns, whole minutes that enclose the message's.
        salt: Drawn at the encryptor's start; gives, with the subject's key, this message's key.
        number: Counts what was sealed under this salt: the nonce.
        ciphertext: Of AES-256-GCM, with its tag.
        mac: 8 bytes of HMAC-SHA-256 over node and plaintext under the subject's key: two sealings
            of one message share it, so that they differ from two messages under one number.
    """

    position: Position
    place: Place
    kind: Kind
    subject: str
    time: tuple[int, int]
    salt: bytes
    number: int
    ciphertext: bytes = b""
    mac: bytes = bytes(MAC_BYTES)

    def encode(self) -> bytes:
        """The bytes, always the same."""
        return dump(self._head() | {10: self.ciphertext})

    @property
    def layout(self) -> bytes | None:
        """Hash of the layout by which a frame or statements are read."""
        if isinstance(self.place, tuple):
            return self.place[0]
        return self.place if isinstance(self.place, bytes) else None

    @property
    def place_name(self) -> str:
        """The place as a text: a hash in hexadecimal, of a frame with its page; or `UNREAD`."""
        return name_place(self.place)

    @property
    def shared(self) -> bytes:
        """What is the same each time that a message is sealed for its subject."""
        return cbor2.dumps([_listed(self.place), int(self.kind), self.subject, self.mac])

    def bound(self, node: str) -> bytes:
        """The associated data: all that stands in the clear, and the node that sent it."""
        return cbor2.dumps(["eskin subject 1", node, self._head()])

    @classmethod
    def decode(cls, data: bytes) -> Self:
        """Read a encrypted message.

        Raises:
            MessageError: It is none.
        """
        fields = load(data)
        if fields.integer(1, 0, 255) != Kind.ENCRYPTED:
            raise MessageError("field 1 is not that of a encrypted message")
        return cls.read(fields)

    @classmethod
    def read(cls, fields: Fields) -> Self:
        """Read a encrypted message from its decoded fields."""
        fields.only(_FIELDS)
        kind = fields.integer(5, 0, 255)
        if kind not in _KINDS:
            raise MessageError(f"field 5 is {kind}; only frames and statements are encrypted")
        subject = fields.text(6, 32)
        if not is_pseudonym(subject):
            raise MessageError("field 6 is no pseudonym of 32 hexadecimal digits")
        return cls(
            position=read_position(fields),
            place=_place(fields, Kind(kind)),
            kind=Kind(kind),
            subject=subject,
            time=fields.instants(7),
            salt=_bytes(fields, 8, SALT_BYTES, SALT_BYTES),
            number=fields.integer(9, 0, MOST_COUNT),
            ciphertext=_bytes(fields, 10, 16, MOST_BYTES),
            mac=_bytes(fields, 11, MAC_BYTES, MAC_BYTES),
        )

    def _head(self) -> dict[int, object]:
        head: dict[int, object] = position_fields(Kind.ENCRYPTED, self.position)
        head |= {4: _listed(self.place), 5: int(self.kind), 6: self.subject, 7: list(self.time)}
        return head | {8: self.salt, 9: self.number, 11: self.mac}


def is_sealed(data: bytes) -> bool:
    """Whether bytes can only be a encrypted message; deterministic CBOR begins like this."""
    return data.startswith(_BEGINNING)


def whole_minutes(time: tuple[int, int]) -> tuple[int, int]:
    """The whole minutes that enclose a time; not beyond what 64 bit hold.

    Exact instants are biometric; the minute is less so.
    """
    lo, hi = time[0] // MINUTE * MINUTE, -(-time[1] // MINUTE) * MINUTE
    return max(lo, -MOST_INSTANT), min(hi, MOST_INSTANT)


def name_place(place: Place) -> str:
    """A place as a text."""
    if isinstance(place, str):
        return place
    return place.hex() if isinstance(place, bytes) else f"{place[0].hex()}.{place[1]}"


def read_page(name: str) -> tuple[bytes, int] | None:
    """Layout and page of a frame's place, as `name_place` writes it; ``None`` for other places."""
    layout, point, page = name.partition(".")
    if len(layout) != 2 * HASH_BYTES or not point:
        return None
    return bytes.fromhex(layout), int(page)


def _place(fields: Fields, kind: Kind) -> Place:
    if kind is Kind.ENCRYPTED:
        if fields.text(4, len(UNREAD)) != UNREAD:
            raise MessageError(f"field 4 is not {UNREAD!r}, the place of what could not be read")
        return UNREAD
    if kind is Kind.STATEMENTS:
        return fields.octets(4, HASH_BYTES, HASH_BYTES)
    layout, page = pair(fields.raw(4), "field 4")
    return octets(layout, "field 4, layout", HASH_BYTES, HASH_BYTES), integer(
        page, "field 4, page", 0, MOST_PAGES - 1
    )


def _listed(place: Place) -> object:
    return list(place) if isinstance(place, tuple) else place


def _bytes(fields: Fields, key: int, least: int, most: int) -> bytes:
    value = fields.raw(key)
    if not isinstance(value, bytes) or not least <= len(value) <= most:
        raise MessageError(f"field {key} is no byte string of {least} to {most} bytes")
    return value
