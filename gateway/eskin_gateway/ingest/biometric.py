"""The one place where the gateway seals what tells of a person, before anything is written."""

from __future__ import annotations

import hmac
from typing import TYPE_CHECKING, Final

from eskin.privacy import Encryptor, is_biometric, is_impersonal
from eskin.privacy.cipher import span
from eskin.wire.messages import Block, BlockSummary, Peak, decode_message

if TYPE_CHECKING:
    from eskin.wire.messages import Position, Summary
    from eskin_gateway.spool.batch import DeadLetter
    from eskin_gateway.spool.subject_assignments import SubjectAssignments

WITHHELD: Final = "cannot be read; it is kept sealed with the reason, as it may tell of a person"


class BiometricEncryptor:
    """Seals blocks and peaks of biometric channels. Only for one thread.

    Args:
        assignments: Whose data they are.
    """

    def __init__(self, assignments: SubjectAssignments) -> None:
        self._assignments = assignments
        self._encryptor = Encryptor()

    def forget(self, pseudonym: str) -> None:
        """Drop what was derived from an erased subject's key; from any thread."""
        self._encryptor.forget(pseudonym)

    def read(self, summary: Summary, plaintext: bytes) -> Block | Peak | None:
        """A message that tells of a person, whole: behind us nobody can check it any more.

        Raises:
            MessageError: It is none.
        """
        if not isinstance(summary, BlockSummary | Peak) or not is_biometric(summary.channel):
            return None
        message = decode_message(plaintext)
        return message if isinstance(message, Block | Peak) else None

    def guard(self, node: str, message: Block | Peak | None, plaintext: bytes) -> bytes:
        """What may be written of what `read` gave: its plaintext, or a veiled message.

        Raises:
            PrivacyError: No key can be had.
        """
        if message is None:
            return plaintext
        subject = self._assignments.subject(node, span(message)[0])
        return self._encryptor.veil(subject, node, message, plaintext).encode()

    def guard_unread(self, letter: DeadLetter, position: Position | None) -> DeadLetter:
        """What may be written of a message that nobody can read: body and reason sealed together.

        Raises:
            PrivacyError: No key can be had.
        """
        if is_impersonal(letter.body):
            return letter
        subject = self._assignments.subject(letter.node, letter.at)
        plaintext = b"%b\n%b" % (letter.reason.encode(), letter.body)
        veiled = self._encryptor.veil_unread(
            subject, letter.node, position, plaintext, now=letter.at
        )
        mark = hmac.digest(subject.key, letter.body, "sha256")
        return letter._replace(reason=WITHHELD, body=veiled.encode(), mark=mark)
