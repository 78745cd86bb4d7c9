"""Sealing messages."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

import cbor2
from cryptography.hazmat.primitives.ciphers.aead import AESGCM

from eskin.identity.certificates import der, thumbprint
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
    associated_data,
)
from eskin.wire.envelope.key_agreement import agree_key

if TYPE_CHECKING:
    from collections.abc import Callable

    from cryptography import x509

    from eskin.identity.identity import Identity
    from eskin.wire.messages.header import Position


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
