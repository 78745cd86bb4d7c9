"""The gateway's word that messages are durable; only then a node forgets them."""

from __future__ import annotations

from dataclasses import dataclass
from hashlib import sha256
from typing import Final, Self

from eskin.errors import MessageError
from eskin.wire.messages.cbor_map import dump, load, octets, read_span
from eskin.wire.messages.header import Kind
from eskin.wire.timestamp import MOST_INSTANT

MOST_SPANS: Final = 1000
MOST_WANTED: Final = 256
_HASH_BYTES: Final = sha256().digest_size
_FIELDS: Final = frozenset({1, 2, 3, 4})


@dataclass(frozen=True, slots=True)
class Acknowledgement:
    """What is durable at the gateway.

    Attributes:
        time: The gateway's clock, UTC ns.
        spans: ``(boot, first, last)`` of the messages.
        want: Hashes of patches and layouts of the node that the gateway lacks. The node sends them,
            and what it sent that is not acknowledged, again.
    """

    time: int
    spans: tuple[tuple[int, int, int], ...]
    want: tuple[bytes, ...] = ()

    def encode(self) -> bytes:
        """Write as CBOR."""
        spans = [list(span) for span in self.spans]
        fields: dict[int, object] = {1: int(Kind.ACKNOWLEDGEMENT), 2: self.time, 3: spans}
        return dump(fields | ({4: list(self.want)} if self.want else {}))

    @classmethod
    def decode(cls, data: bytes) -> Self:
        """Read an acknowledgement.

        Raises:
            MessageError: It is none.
        """
        fields = load(data)
        fields.only(_FIELDS)
        kind = fields.integer(1, 0, 255)
        if kind != Kind.ACKNOWLEDGEMENT:
            raise MessageError(
                f"field 1 is {kind}; expected an acknowledgement ({Kind.ACKNOWLEDGEMENT:d})"
            )
        return cls(
            time=fields.integer(2, -MOST_INSTANT, MOST_INSTANT),
            spans=tuple(read_span(span, "field 3") for span in fields.items(3, MOST_SPANS)),
            want=tuple(
                octets(wanted, "field 4", _HASH_BYTES, _HASH_BYTES)
                for wanted in fields.optional_items(4, MOST_WANTED)
            ),
        )
