"""An envelope as nodes seal it, read without a general decoder: a third of its cost.

What is found here is what the general way finds. Where anything is not as most envelopes have it,
nothing is found, and the general way tells what is wrong, or that nothing is.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Final, NamedTuple

import cbor2

from eskin.errors import MalformedEnvelopeError
from eskin.wire.envelope.cose_labels import HELD, IV, IV_BYTES, MOST_ENVELOPE
from eskin.wire.envelope.header import Header
from eskin.wire.messages.cbor_map import MOST_COUNT
from eskin.wire.messages.header import Position

_BEGINNING: Final = b"\xd0\x83\x58"  # tag 16, an array of 3, a byte string of up to 255
_NONCE: Final = cbor2.dumps({IV: bytes(IV_BYTES)})[:-IV_BYTES]
_SEALED: Final = b"\x59"  # a byte string of up to 65535
_HELD: Final = cbor2.dumps(HELD) + b"\x82"  # followed by a pair


class Parts(NamedTuple):
    """An envelope's parts; a tuple, because there are many.

    Attributes:
        protected: The protected header's bytes, which are authenticated.
        header: What they say.
        iv: The nonce.
        sealed: The ciphertext.
    """

    protected: bytes
    header: Header
    iv: bytes
    sealed: bytes


def read_ordinary(envelope: bytes) -> Parts | None:
    """Read an envelope with what its sender still holds, and no certificates; else `None`."""
    if len(envelope) > MOST_ENVELOPE or envelope[:3] != _BEGINNING:
        return None
    nonce = 4 + int.from_bytes(envelope[3:4])
    iv = nonce + len(_NONCE)
    sealed = iv + IV_BYTES
    if envelope[nonce:iv] != _NONCE or envelope[sealed : sealed + 1] != _SEALED:
        return None
    if len(envelope) != sealed + 3 + int.from_bytes(envelope[sealed + 1 : sealed + 3]):
        return None
    protected = envelope[4:nonce]
    header = _read_header(protected)
    if header is None:
        return None
    return Parts(protected, header, envelope[iv:sealed], envelope[sealed + 3 :])


def _read_header(protected: bytes) -> Header | None:
    """What most headers of a sender have in common is read once."""
    end = protected.rfind(_HELD) + len(_HELD)
    boot, place = _count(protected, end)
    sequence, place = _count(protected, place)
    if place != len(protected):
        return None
    common = _read_common(protected[:end])
    if common is None:
        return None
    return Header(common.salt, common.sender, common.recipient, Position(boot, sequence))


@lru_cache(4096)
def _read_common(begun: bytes) -> Header | None:
    """A header up to the pair of what its sender holds."""
    try:
        header = Header.read(begun + b"\0\0")
    except MalformedEnvelopeError:
        return None
    return header if header.held == Position(0, 0) else None


def _count(data: bytes, place: int) -> tuple[int, int]:
    """A number, and where it ends; past the end of all where there is none."""
    short = int.from_bytes(data[place : place + 1])
    if short < 24:
        return short, place + 1
    width = 1 << (short - 24)
    number = int.from_bytes(data[place + 1 : place + 1 + width])
    return number, place + 1 + width if short < 28 and number <= MOST_COUNT else len(data) + 1
