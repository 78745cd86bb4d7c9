"""COSE_Encrypt0 with static keys (RFC 9052, section 5.2): `Sealer` encrypts, `Opener` decrypts.

An envelope as nodes seal it is read without a general decoder, at a third of its cost. What is
found so is what the general decoder finds; where anything is unusual, that one reads it.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import cbor2
from cachetools import FIFOCache
from cryptography.exceptions import InvalidTag
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.ciphers.aead import AESGCM
from cryptography.hazmat.primitives.hashes import SHA256
from cryptography.hazmat.primitives.kdf.hkdf import HKDF

from eskin.errors import (
    ForgedEnvelopeError,
    UnknownRecipientError,
    UnknownSenderError,
)
from eskin.identity.certificates import common_name, der, public_key, thumbprint
from eskin.wire.envelope.header import (
    A256GCM,
    ALG,
    CHAIN,
    ENCRYPT0,
    HELD,
    IV,
    IV_BYTES,
    RECIPIENT,
    SALT,
    SALT_BYTES,
    SENDER,
    SHA256_ID,
    Header,
    associated_data,
    read_iv,
    read_parts,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from cryptography import x509

    from eskin.identity.identity import Identity
    from eskin.wire.messages.header import Position


def agree_key(
    private: ec.EllipticCurvePrivateKey,
    peer: x509.Certificate,
    sender: x509.Certificate,
    recipient: x509.Certificate,
    salt: bytes,
) -> bytes:
    """ECDH of P-256, then HKDF-SHA-256 with a COSE_KDF_Context (RFC 9053, sections 5.1, 5.2, 6.3).

    Args:
        private: The own key.
        peer: The other party's certificate.
        sender: The sealer's certificate.
        recipient: The opener's certificate.
        salt: The sender's.

    Returns:
        32 bytes.
    """
    secret = private.exchange(ec.ECDH(), public_key(peer))
    parties = [
        [common_name(party).encode(), None, thumbprint(party)] for party in (sender, recipient)
    ]
    context = cbor2.dumps([A256GCM, *parties, [256, b"", b"eskin/v1"]])
    return HKDF(algorithm=SHA256(), length=32, salt=salt, info=context).derive(secret)


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
        self._salt = random(SALT_BYTES)
        self._own = own
        self._header: dict[int, object] = {
            ALG: A256GCM,
            SALT: self._salt,
            SENDER: [SHA256_ID, own.thumbprint],
            RECIPIENT: [SHA256_ID, thumbprint(peer)],
        }
        self._cipher = AESGCM(agree_key(own.key, peer, own.certificate, peer, self._salt))
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
            held: The lowest position still held, authenticated.
            introduce: Whether to add the certificate chain, so that a new recipient can open it.
        """
        header = self._header
        if held is not None:
            header = header | {HELD: [held.boot, held.sequence]}
        protected = cbor2.dumps(header)
        iv = self._count.to_bytes(IV_BYTES)
        self._count += 1
        unprotected: dict[int, object] = {IV: iv}
        if introduce:
            unprotected[CHAIN] = [der(certificate) for certificate in self._own.chain]
        sealed = self._cipher.encrypt(iv, plaintext, associated_data(protected, topic))
        return cbor2.dumps(cbor2.CBORTag(ENCRYPT0, [protected, unprotected, sealed]))


class Opened(NamedTuple):
    """What an envelope held, after it proved genuine; a tuple, because there are many.

    Attributes:
        plaintext: The message.
        sender: Common name in the sender's certificate.
        held: The lowest position that the sender still holds, where it stated so.
        thumbprint: SHA-256 of the sender's certificate, to which an answer is sealed.
    """

    plaintext: bytes
    sender: str
    held: Position | None
    thumbprint: bytes


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
        self._keys: dict[bytes, Identity] = {}
        self.take(keys)
        self._find = sender
        self._senders: FIFOCache[tuple[bytes, bytes, bytes], _Sender] = FIFOCache(capacity)
        self._addressed: FIFOCache[bytes, bytes] = FIFOCache(capacity)

    def take(self, keys: Sequence[Identity]) -> None:
        """Open messages that are sealed to these keys from now on, and to no other."""
        self._keys = {key.thumbprint: key for key in keys}

    def addressed(self, sender: bytes) -> bytes | None:
        """Thumbprint of ours to which a sender, named by its thumbprint, sealed last."""
        return self._addressed.get(sender)

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
        protected, header, iv, sealed = _read(envelope)
        own = self._keys.get(header.recipient)
        if own is None:
            raise UnknownRecipientError(header.recipient)
        certificate = self._find(header.sender)
        if certificate is None:
            raise UnknownSenderError(header.sender)
        key = (header.sender, header.recipient, header.salt)
        sender = self._senders.get(key)
        if sender is None:
            shared = agree_key(own.key, certificate, certificate, own.certificate, header.salt)
            sender = _Sender(AESGCM(shared), common_name(certificate))
        try:
            plaintext = sender.cipher.decrypt(iv, sealed, associated_data(protected, topic))
        except InvalidTag as error:
            raise ForgedEnvelopeError(
                f"authentication failed for sender {sender.name!r} on {topic!r}"
            ) from error
        # Cached only now, so that forged salts cannot evict genuine senders.
        self._senders[key] = sender
        self._addressed[header.sender] = header.recipient
        return Opened(plaintext, sender.name, header.held, header.sender)


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


def _read(envelope: bytes) -> Parts:
    protected, unprotected, sealed = read_parts(envelope)
    return Parts(protected, Header.read(protected), read_iv(unprotected), sealed)


@dataclass(frozen=True, slots=True)
class _Sender:
    """One sender under one salt: its key, and its common name."""

    cipher: AESGCM
    name: str
