"""Sealed messages: COSE_Encrypt0 (RFC 9052, section 5.2) with AES-256-GCM (RFC 9053, section 4.1).

The content key comes from static-static ECDH P-256 between the sender's and the recipient's
certificates, through HKDF-SHA-256 with a COSE_KDF_Context (RFC 9053, sections 5.1, 5.2 and 6.3).

Nonces never repeat: every start of every sender draws a fresh salt from the operating system and
counts from zero under the key that this salt gives. Both parties are in the context, so each
direction has keys of its own.

Protected header: 1 alg (A256GCM), -20 salt, -27 x5t-sender and 34 x5t (RFC 9360: sender's and
recipient's certificates), and ``HELD``: the lowest boot and sequence that the sender still holds.
Unprotected: 5 IV, and -29 x5chain-sender where the sender introduces itself.
External data: the topic. So a message moved to another topic is no message.
"""

from __future__ import annotations

import os
from collections import OrderedDict
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import cbor2
from cryptography.exceptions import InvalidTag
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.ciphers.aead import AESGCM
from cryptography.hazmat.primitives.hashes import SHA256
from cryptography.hazmat.primitives.kdf.hkdf import HKDF

from eskin.errors import (
    ForgedEnvelopeError,
    MalformedEnvelopeError,
    MessageError,
    UnknownRecipientError,
    UnknownSenderError,
)
from eskin.identity.certificates import common_name, der, public_key, thumbprint
from eskin.messages.fields import MOST_BYTES, MOST_COUNT, integer, load_any
from eskin.messages.head import Position

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from cryptography import x509

    from eskin.identity.identity import Identity

MOST_ENVELOPE: Final = MOST_BYTES + 8_192
"""Size limit of a sealed message: the message, headers and a certificate chain."""
HELD: Final = -70_001
"""Header label (private use) of the lowest position that a node still holds."""
_ENCRYPT0: Final = 16
_ALG, _IV, _SALT, _SENDER, _RECIPIENT, _CHAIN = 1, 5, -20, -27, 34, -29
_A256GCM: Final = 3
_SHA256: Final = -16
_SALT_BYTES: Final = 16
_IV_BYTES: Final = 12


@dataclass(frozen=True, slots=True)
class Opened:
    """What an envelope held, after it proved genuine.

    Attributes:
        plaintext: The message.
        sender: Common name in the sender's certificate.
        held: The lowest position that the sender still holds, where it said so.
        thumbprint: SHA-256 of the sender's certificate, to which an answer is sealed.
    """

    plaintext: bytes
    sender: str
    held: Position | None
    thumbprint: bytes


class Sealer:
    """Seals messages from one identity to one certificate. Not for several threads at once.

    Args:
        own: The sender.
        peer: The recipient's certificate.
        random: Source of the salt.
    """

    def __init__(
        self,
        own: Identity,
        peer: x509.Certificate,
        *,
        random: Callable[[int], bytes] = os.urandom,
    ) -> None:
        self._salt = random(_SALT_BYTES)
        self._own = own
        self._header: dict[int, object] = {
            _ALG: _A256GCM,
            _SALT: self._salt,
            _SENDER: [_SHA256, own.thumbprint],
            _RECIPIENT: [_SHA256, thumbprint(peer)],
        }
        self._cipher = AESGCM(_agree(own.key, peer, own.certificate, peer, self._salt))
        self._count = 0

    def seal(
        self,
        plaintext: bytes,
        *,
        topic: str,
        held: Position | None = None,
        introduce: bool = False,
    ) -> bytes:
        """Seal a message.

        Args:
            plaintext: The message.
            topic: Where it will be published; it opens under no other.
            held: The lowest position still held, told under authentication.
            introduce: Whether to add the certificate chain, so that a stranger can open it.
        """
        header = self._header
        if held is not None:
            header = header | {HELD: [held.boot, held.sequence]}
        protected = cbor2.dumps(header)
        iv = self._count.to_bytes(_IV_BYTES)
        self._count += 1
        unprotected: dict[int, object] = {_IV: iv}
        if introduce:
            unprotected[_CHAIN] = [der(certificate) for certificate in self._own.chain]
        sealed = self._cipher.encrypt(iv, plaintext, _associated(protected, topic))
        return cbor2.dumps(cbor2.CBORTag(_ENCRYPT0, [protected, unprotected, sealed]))


class Opener:
    """Opens messages that are sealed to one of our keys. Not for several threads at once.

    Args:
        keys: Our identities that messages may be sealed to.
        sender: Finds a sender's verified certificate by its thumbprint; ``None`` if unknown.
        capacity: How many senders' keys are remembered.
    """

    def __init__(
        self,
        keys: Sequence[Identity],
        *,
        sender: Callable[[bytes], x509.Certificate | None],
        capacity: int = 4096,
    ) -> None:
        self._keys = {key.thumbprint: key for key in keys}
        self._find = sender
        self._capacity = capacity
        self._ciphers: OrderedDict[tuple[bytes, bytes, bytes], AESGCM] = OrderedDict()

    def open(self, envelope: bytes, *, topic: str) -> Opened:
        """Open a message.

        Args:
            envelope: The sealed bytes.
            topic: Where it arrived.

        Raises:
            MalformedEnvelopeError: The bytes are no envelope of ours.
            UnknownRecipientError: It is not sealed to one of our keys.
            UnknownSenderError: The sender's certificate is not known (yet).
            ForgedEnvelopeError: Authentication fails.
        """
        protected, unprotected, sealed = _parts(envelope)
        header = _Header.read(protected)
        own = self._keys.get(header.recipient)
        if own is None:
            raise UnknownRecipientError(header.recipient)
        certificate = self._find(header.sender)
        if certificate is None:
            raise UnknownSenderError(header.sender)
        key = (header.sender, header.recipient, header.salt)
        cipher = self._ciphers.get(key)
        known = cipher is not None
        if cipher is None:
            shared = _agree(own.key, certificate, certificate, own.certificate, header.salt)
            cipher = AESGCM(shared)
        try:
            plaintext = cipher.decrypt(_iv(unprotected), sealed, _associated(protected, topic))
        except InvalidTag as error:
            raise ForgedEnvelopeError(
                f"authentication failed for sender {common_name(certificate)!r} on {topic!r}"
            ) from error
        # Remembered only now, so that forged salts cannot push genuine senders out.
        self._remember(key, cipher, known=known)
        return Opened(plaintext, common_name(certificate), header.held, header.sender)

    def _remember(self, key: tuple[bytes, bytes, bytes], cipher: AESGCM, *, known: bool) -> None:
        if known:
            self._ciphers.move_to_end(key)
            return
        self._ciphers[key] = cipher
        if len(self._ciphers) > self._capacity:
            self._ciphers.popitem(last=False)


def introduction(envelope: bytes) -> tuple[bytes, ...] | None:
    """The sender's certificate chain (DER), where the envelope carries it; not verified yet.

    Raises:
        MalformedEnvelopeError: The bytes are no envelope of ours.
    """
    _, unprotected, _ = _parts(envelope)
    chain = unprotected.get(_CHAIN)
    if chain is None:
        return None
    if not isinstance(chain, list) or not all(isinstance(item, bytes) for item in chain):
        raise MalformedEnvelopeError("header x5chain-sender is no array of byte strings")
    return tuple(chain)


@dataclass(frozen=True, slots=True)
class _Header:
    salt: bytes
    sender: bytes
    recipient: bytes
    held: Position | None

    @classmethod
    def read(cls, protected: bytes) -> _Header:
        header = _load(protected, "protected header")
        if not isinstance(header, dict):
            raise MalformedEnvelopeError("protected header is no map")
        if header.get(_ALG) != _A256GCM:
            raise MalformedEnvelopeError("algorithm is not A256GCM (3)")
        salt = header.get(_SALT)
        if not isinstance(salt, bytes) or len(salt) != _SALT_BYTES:
            raise MalformedEnvelopeError(f"salt is not {_SALT_BYTES} bytes")
        return cls(salt, _hash(header, _SENDER), _hash(header, _RECIPIENT), _held(header))


def _hash(header: Mapping[object, object], label: int) -> bytes:
    value = header.get(label)
    if isinstance(value, list) and len(value) == 2 and value[0] == _SHA256:
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
        boot, sequence = (integer(number, "header `held`", 0, MOST_COUNT) for number in value)
    except MessageError as error:
        raise MalformedEnvelopeError(str(error)) from error
    return Position(boot, sequence)


def _parts(envelope: bytes) -> tuple[bytes, dict[object, object], bytes]:
    if len(envelope) > MOST_ENVELOPE:
        raise MalformedEnvelopeError(
            f"envelope of {len(envelope)} bytes; at most {MOST_ENVELOPE} are allowed"
        )
    tagged = _load(envelope, "envelope")
    if isinstance(tagged, cbor2.CBORTag) and tagged.tag == _ENCRYPT0:
        value = tagged.value
        if isinstance(value, list) and len(value) == 3:
            protected, unprotected, sealed = value
            if (
                isinstance(protected, bytes)
                and isinstance(unprotected, dict)
                and isinstance(sealed, bytes)
            ):
                return protected, unprotected, sealed
    raise MalformedEnvelopeError("envelope is no COSE_Encrypt0 (RFC 9052, section 5.2)")


def _load(data: bytes, what: str) -> object:
    try:
        return load_any(data, what)
    except MessageError as error:
        raise MalformedEnvelopeError(str(error)) from error


def _iv(unprotected: Mapping[object, object]) -> bytes:
    iv = unprotected.get(_IV)
    if not isinstance(iv, bytes) or len(iv) != _IV_BYTES:
        raise MalformedEnvelopeError(f"IV is not {_IV_BYTES} bytes")
    return iv


def _associated(protected: bytes, topic: str) -> bytes:
    """Enc_structure of RFC 9052, section 5.3."""
    return cbor2.dumps(["Encrypt0", protected, topic.encode()])


def _agree(
    private: ec.EllipticCurvePrivateKey,
    peer: x509.Certificate,
    sender: x509.Certificate,
    recipient: x509.Certificate,
    salt: bytes,
) -> bytes:
    secret = private.exchange(ec.ECDH(), public_key(peer))
    parties = [
        [common_name(party).encode(), None, thumbprint(party)] for party in (sender, recipient)
    ]
    context = cbor2.dumps([_A256GCM, *parties, [256, b"", b"eskin/v1"]])
    return HKDF(algorithm=SHA256(), length=32, salt=salt, info=context).derive(secret)
