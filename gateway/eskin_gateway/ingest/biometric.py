"""Encrypts biometric data before anything is written."""

from __future__ import annotations

import hmac
from typing import TYPE_CHECKING, Final

from eskin.privacy import Encryptor, is_not_biometric
from eskin.privacy.cipher import span

if TYPE_CHECKING:
    from eskin.privacy.cipher import Sealable
    from eskin.wire.messages import Position
    from eskin_gateway.spool.batch import DeadLetter
    from eskin_gateway.spool.subject_assignments import SubjectAssignments

WITHHELD: Final = "unreadable; encrypted with the reason, as it may be biometric"


class BiometricEncryptor:
    """Encrypts messages of biometric patches. Not thread-safe.

    Args:
        assignments: Finds the subject of a message.
    """

    def __init__(self, assignments: SubjectAssignments) -> None:
        self._assignments = assignments
        self._encryptor = Encryptor()

    def forget(self, pseudonym: str) -> None:
        """Drop keys derived from an erased subject's key. Thread-safe."""
        self._encryptor.forget(pseudonym)

    def encrypt(self, node: str, message: Sealable, plaintext: bytes) -> bytes:
        """Encrypt a biometric message.

        Raises:
            PrivacyError: The subject has no key.
        """
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
