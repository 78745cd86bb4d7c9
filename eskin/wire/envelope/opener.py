"""Open messages.

An envelope as nodes seal it is read without a general decoder, at a third of its cost. What is
found so is what the general decoder finds; where anything is unusual, that one reads it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

from cachetools import FIFOCache
from cryptography.exceptions import InvalidTag
from cryptography.hazmat.primitives.ciphers.aead import AESGCM

from eskin.errors import (
    ForgedEnvelopeError,
    UnknownRecipientError,
    UnknownSenderError,
)
from eskin.identity.certificates import common_name
from eskin.wire.envelope.header import Header, associated_data, read_iv, read_parts
from eskin.wire.envelope.key_agreement import agree_key

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from cryptography import x509

    from eskin.identity.identity import Identity
    from eskin.wire.messages.header import Position


class Opened(NamedTuple):
    """What an envelope held, after it proved genuine; a tuple, because there are many.

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
