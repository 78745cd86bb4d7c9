"""Encrypts biometric data before anything is written."""

from __future__ import annotations

import hmac
from typing import TYPE_CHECKING, Final

from eskin.privacy import Encryptor, is_biometric, is_not_biometric
from eskin.privacy.cipher import span
from eskin.wire.messages import Block, BlockSummary, Peak, decode_message

if TYPE_CHECKING:
    from eskin.wire.messages import Position
    from eskin_gateway.ingest.node_messages import Numbered
    from eskin_gateway.spool.batch import DeadLetter
    from eskin_gateway.spool.subject_assignments import SubjectAssignments

WITHHELD: Final = "unreadable; encrypted with the reason, as it may be biometric"


class BiometricEncryptor:
    """Encrypts blocks and peaks of biometric channels. Not thread-safe.

    Args:
        assignments: Finds the subject of a message.
    """

    def __init__(self, assignments: SubjectAssignments) -> None:
        self._assignments = assignments
        self._encryptor = Encryptor()

    def forget(self, pseudonym: str) -> None:
        """Drop keys derived from an erased subject's key. Thread-safe."""
        self._encryptor.forget(pseudonym)

    def read(self, summary: Numbered, plaintext: bytes) -> Block | Peak | None:
        """Decode a biometric message completely: behind the gateway it cannot be checked.

        Returns:
            The message, or ``None`` if it is not biometric.

        Raises:
            MessageError: It is invalid.
        """
        if not isinstance(summary, BlockSummary | Peak) or not is_biometric(summary.channel):
            return None
        message = decode_message(plaintext)
        return message if isinstance(message, Block | Peak) else None

    def encrypt(self, node: str, message: Block | Peak | None, plaintext: bytes) -> bytes:
        """Encrypt a message that `read` returned; else return the plaintext.

        Raises:
            PrivacyError: The subject has no key.
        """
        if message is None:
            return plaintext
        subject = self._assignments.subject(node, span(message)[0])
        return self._encryptor.encrypt(subject, node, message, plaintext).encode()

    def encrypt_dead_letter(self, letter: DeadLetter, position: Position | None) -> DeadLetter:
        """Encrypt body and reason of a dead letter that may be biometric.

        Raises:
            PrivacyError: The subject has no key.
        """
        if is_not_biometric(letter.body):
            return letter
        subject = self._assignments.subject(letter.node, letter.time)
        plaintext = b"%b\n%b" % (letter.reason.encode(), letter.body)
        sealed = self._encryptor.encrypt_unreadable(
            subject, letter.node, position, plaintext, now=letter.time
        )
        fingerprint = hmac.digest(subject.key, letter.body, "sha256")
        return letter._replace(reason=WITHHELD, body=sealed.encode(), fingerprint=fingerprint)
