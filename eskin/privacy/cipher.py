"""Sealing under a subject's key, and reading it again: AES-256-GCM.

Nonces never repeat: each encryptor draws a salt at its start (`eskin.privacy.derivation`).
"""

from __future__ import annotations

import hmac
import itertools
import os
from dataclasses import replace
from threading import Lock
from typing import TYPE_CHECKING, Final, TypeAlias

from cachetools import LRUCache
from cryptography.exceptions import InvalidTag

from eskin.errors import BrokenSealError, MessageError, PrivacyError
from eskin.privacy.derivation import derive, nonce
from eskin.privacy.sealed_message import MAC_BYTES, SALT_BYTES, UNREAD, SealedMessage, whole_minutes
from eskin.wire.frames import EncodedFrame, Statements
from eskin.wire.messages.header import Kind, Position

if TYPE_CHECKING:
    from cryptography.hazmat.primitives.ciphers.aead import AESGCM

    from eskin.privacy.keystore import KeyStore
    from eskin.privacy.sealed_message import Place
    from eskin.privacy.subject import Subject

Sealable: TypeAlias = EncodedFrame | Statements
"""A message whose samples, or what is concluded from them, may be about a person."""
_KEPT: Final = 256
_MOST_LETTER: Final = 60_000


class Encryptor:
    """Seals; one for each start of a process. Only for one thread."""

    def __init__(self) -> None:
        self._salt = os.urandom(SALT_BYTES)
        self._numbers = itertools.count()
        self._keys = _Keys()

    def encrypt(
        self, subject: Subject, node: str, message: Sealable, plaintext: bytes
    ) -> SealedMessage:
        """Seal a message.

        Args:
            subject: Whose data it is.
            node: Its sender.
            message: As it was decoded.
            plaintext: Its bytes.
        """
        time = whole_minutes(span(message))
        head = message.position, *_find_place(message), time
        return self._seal(subject, node, head, plaintext)

    def encrypt_unreadable(
        self, subject: Subject, node: str, position: Position | None, plaintext: bytes, *, now: int
    ) -> SealedMessage:
        """Encrypt unreadable bytes, which may be biometric.

        Args:
            subject: Whose data it may be.
            node: Its sender.
            position: As far as it could be read.
            plaintext: The bytes; of very long ones the beginning is kept.
            now: UTC ns.
        """
        head = position or Position(0, 0), UNREAD, Kind.ENCRYPTED, whole_minutes((now, now))
        return self._seal(subject, node, head, plaintext[:_MOST_LETTER])

    def forget(self, pseudonym: str) -> None:
        """Drop what was derived from a subject's key."""
        self._keys.forget(pseudonym)

    def _seal(
        self,
        subject: Subject,
        node: str,
        head: tuple[Position, Place, Kind, tuple[int, int]],
        plaintext: bytes,
    ) -> SealedMessage:
        position, place, kind, time = head
        number = next(self._numbers)
        authenticated = b"eskin message 1\0%b\0" % node.encode() + plaintext
        mac = hmac.digest(subject.key, authenticated, "sha256")[:MAC_BYTES]
        clear = SealedMessage(
            position, place, kind, subject.pseudonym, time, self._salt, number, mac=mac
        )
        aead = self._keys.find(subject, self._salt)
        return replace(clear, ciphertext=aead.encrypt(nonce(number), plaintext, clear.bound(node)))


class Decryptor:
    """Reads what was encrypted, as long as the subject's key is there.

    Args:
        keystore: Holds the keys; asked for each message, so that what is erased is erased at once.
    """

    def __init__(self, keystore: KeyStore) -> None:
        self._keystore = keystore
        self._keys = _Keys()

    def decrypt(self, node: str, encrypted: SealedMessage) -> bytes:
        """The bytes that were encrypted.

        Raises:
            NoKeyError: The subject's key is not here.
            PrivacyError: It was changed, or moved to another node, place or subject.
        """
        try:
            subject = self._keystore.find(encrypted.subject)
        except PrivacyError:
            self._keys.forget(encrypted.subject)
            raise
        aead = self._keys.find(subject, encrypted.salt)
        try:
            return aead.decrypt(
                nonce(encrypted.number), encrypted.ciphertext, encrypted.bound(node)
            )
        except InvalidTag as error:
            raise BrokenSealError(
                f"message {encrypted.position} of {node} does not decrypt with the key of subject "
                f"{encrypted.subject}"
            ) from error

    def forget(self, pseudonym: str) -> None:
        """Drop what was derived from a subject's key."""
        self._keys.forget(pseudonym)

    def read(self, node: str, encrypted: SealedMessage) -> tuple[Sealable, bytes]:
        """The message that was encrypted, and its bytes.

        Raises:
            PrivacyError: It cannot be read.
        """
        data = self.decrypt(node, encrypted)
        try:
            message = _decode(encrypted.kind, data)
        except MessageError as error:
            raise BrokenSealError(
                f"what {node} sent as {encrypted.position} is no message"
            ) from error
        if message.position != encrypted.position or _find_place(message) != (
            encrypted.place,
            encrypted.kind,
        ):
            raise BrokenSealError(f"what {node} sent as {encrypted.position} is not what it claims")
        return message, data


class _Keys:
    """Keys derived lately, by subject and salt."""

    def __init__(self) -> None:
        self._cache: LRUCache[tuple[str, bytes], AESGCM] = LRUCache(_KEPT)
        self._lock = Lock()

    def find(self, subject: Subject, salt: bytes) -> AESGCM:
        place = subject.pseudonym, salt
        with self._lock:
            aead = self._cache.get(place)
            if aead is None:
                aead = self._cache[place] = derive(subject.key, salt, b"eskin subject 1")
            return aead

    def forget(self, pseudonym: str) -> None:
        with self._lock:
            for place in [known for known in self._cache if known[0] == pseudonym]:
                del self._cache[place]


def _decode(kind: Kind, data: bytes) -> Sealable:
    return EncodedFrame.decode(data) if kind is Kind.FRAME else Statements.decode(data)


def _find_place(message: Sealable) -> tuple[Place, Kind]:
    if isinstance(message, EncodedFrame):
        return (message.layout, message.page), Kind.FRAME
    return message.layout, Kind.STATEMENTS


def span(message: Sealable) -> tuple[int, int]:
    """From the earliest instant to the latest of which a message has data, UTC ns.

    Columns of a frame that are sampled later than their row may be later still.
    """
    if isinstance(message, Statements):
        times = [each.time for each in message.peaks]
        times += [each.time for each in message.contacts]
        times += [each.time for each in message.verdicts]
        times += [each.time for each in message.gaps]
        return min(lo for lo, _ in times), max(hi for _, hi in times)
    first = min(grid.delay for grid in message.grids)
    last = max(grid.delay + grid.period * (grid.rows - 1) for grid in message.grids)
    return message.time[0] + first, message.time[1] + last
