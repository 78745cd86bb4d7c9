"""Which messages may be biometric."""

from __future__ import annotations

from eskin.errors import MessageError
from eskin.wire.messages import decode_message


def is_not_biometric(plaintext: bytes) -> bool:
    """Whether bytes are certainly not biometric: a status or a result.

    Args:
        plaintext: The whole payload, whether or not it is a message.
    """
    try:
        decode_message(plaintext)
    except MessageError:
        return False
    return True
