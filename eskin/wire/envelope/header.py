"""Reading an envelope's parts and headers: COSE_Encrypt0 (RFC 9052, 9053, 9360)."""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import cbor2

from eskin.errors import MalformedEnvelopeError, MessageError
from eskin.wire.messages.cbor_map import (
    ARRAY,
    BYTES,
    MOST_BYTES,
    MOST_COUNT,
    integer,
    load_any,
    opening,
)
from eskin.wire.messages.header import Position

if TYPE_CHECKING:
    from collections.abc import Mapping


MOST_ENVELOPE: Final = MOST_BYTES + 8_192
"""Size limit of a sealed message: the message, headers and a certificate chain."""
ENCRYPT0: Final = 16
"""CBOR tag."""
ALG: Final = 1
A256GCM: Final = 3
IV: Final = 5
IV_BYTES: Final = 12
SALT: Final = -20
SALT_BYTES: Final = 16
SENDER: Final = -27
"""Header x5t-sender."""
RECIPIENT: Final = 34
"""Header x5t."""
CHAIN: Final = -29
"""Header x5chain-sender."""
SHA256_ID: Final = -16
HELD: Final = -70_001
"""Header (private use) with the lowest position that a node still holds."""
SIGN1: Final = 18
"""CBOR tag."""
ES256: Final = -7
SIGNATURE_BYTES: Final = 64
"""Of ES256: r and s, 32 bytes each."""
SIGNER_CHAIN: Final = 33
"""Header x5chain."""


_STRUCTURE: Final = opening(ARRAY, 3) + cbor2.dumps("Encrypt0")


class Header(NamedTuple):
    """The protected header; a tuple, because there are many.

    Attributes:
        salt: The sender's.
        sender: Thumbprint of the sender's certificate.
        recipient: Thumbprint of the recipient's.
        held: The lowest position that the sender still holds, where it says so.
    """

    salt: bytes
    sender: bytes
    recipient: bytes
    held: Position | None

    @classmethod
    def read(cls, protected: bytes) -> Header:
        """Read it.

        Raises:
            MalformedEnvelopeError: It is none of ours.
        """
        header = load_header(protected)
        if header.get(ALG) != A256GCM:
            raise MalformedEnvelopeError("algorithm is not A256GCM (3)")
        salt = header.get(SALT)
        if not isinstance(salt, bytes) or len(salt) != SALT_BYTES:
            raise MalformedEnvelopeError(f"salt is not {SALT_BYTES} bytes")
        return cls(salt, _hash(header, SENDER), _hash(header, RECIPIENT), _held(header))


def _hash(header: Mapping[object, object], label: int) -> bytes:
    value = header.get(label)
    if isinstance(value, list) and len(value) == 2 and value[0] == SHA256_ID:
        digest = value[1]
        if isinstance(digest, bytes) and len(digest) == 32:
            return digest
    raise MalformedEnvelopeError(f"header {label} is no SHA-256 thumbprint (RFC 9360)")


def _held(header: Mapping[object, object]) -> Position | None:
    value = header.get(HELD)
    if value is None:
        return None
    if not isinstance(value, list) or len(value) != 2:
        raise MalformedEnvelopeError("header `held` is no pair of boot and sequence")
    try:
        boot = integer(value[0], "header `held`", 0, MOST_COUNT)
        sequence = integer(value[1], "header `held`", 0, MOST_COUNT)
    except MessageError as error:
        raise MalformedEnvelopeError(str(error)) from error
    return Position(boot, sequence)


def read_parts(envelope: bytes) -> tuple[bytes, dict[object, object], bytes]:
    """Protected header, unprotected header and ciphertext.

    Raises:
        MalformedEnvelopeError: The bytes are no envelope of ours.
    """
    protected, unprotected, sealed = read_tagged(envelope, ENCRYPT0, 3, "COSE_Encrypt0")
    return protected, unprotected, sealed


def read_tagged(envelope: bytes, tag: int, parts: int, what: str) -> tuple[Any, ...]:
    """Protected header, unprotected header, and the byte strings behind them.

    Raises:
        MalformedEnvelopeError: The bytes are no envelope of that tag.
    """
    if len(envelope) > MOST_ENVELOPE:
        raise MalformedEnvelopeError(
            f"envelope of {len(envelope)} bytes; at most {MOST_ENVELOPE} are allowed"
        )
    tagged = _load(envelope, "envelope")
    if isinstance(tagged, cbor2.CBORTag) and tagged.tag == tag:
        value = tagged.value
        if isinstance(value, list) and len(value) == parts:
            found = tuple(map(type, value))
            if found == (bytes, dict, *(bytes,) * (parts - 2)):
                return tuple(value)
    raise MalformedEnvelopeError(f"envelope is no {what} (RFC 9052)")


def load_header(protected: bytes) -> dict[object, object]:
    """Decode a protected header.

    Raises:
        MalformedEnvelopeError: It is no map.
    """
    header = _load(protected, "protected header")
    if not isinstance(header, dict):
        raise MalformedEnvelopeError("protected header is no map")
    return header


def read_iv(unprotected: Mapping[object, object]) -> bytes:
    """The nonce.

    Raises:
        MalformedEnvelopeError: It is not 12 bytes.
    """
    iv = unprotected.get(IV)
    if not isinstance(iv, bytes) or len(iv) != IV_BYTES:
        raise MalformedEnvelopeError(f"IV is not {IV_BYTES} bytes")
    return iv


def introduction(envelope: bytes) -> tuple[bytes, ...] | None:
    """The sender's certificate chain (DER), where the envelope carries it; not verified yet.

    Raises:
        MalformedEnvelopeError: The bytes are no envelope of ours.
    """
    _, unprotected, _ = read_parts(envelope)
    chain = unprotected.get(CHAIN)
    if chain is None:
        return None
    if not isinstance(chain, list) or not all(isinstance(item, bytes) for item in chain):
        raise MalformedEnvelopeError("header x5chain-sender is no array of byte strings")
    return tuple(chain)


def associated_data(protected: bytes, topic: str) -> bytes:
    """Enc_structure of RFC 9052, section 5.3."""
    head = opening(BYTES, len(protected))
    return b"%b%b%b%b" % (_STRUCTURE, head, protected, _external(topic))


@lru_cache(4096)
def _external(topic: str) -> bytes:
    return cbor2.dumps(topic.encode())


def _load(data: bytes, what: str) -> object:
    try:
        return load_any(data, what)
    except MessageError as error:
        raise MalformedEnvelopeError(str(error)) from error
