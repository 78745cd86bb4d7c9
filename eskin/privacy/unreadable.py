"""Messages that could not be used, of which nobody knows whether they tell of a person."""

from __future__ import annotations

from eskin.errors import MessageError
from eskin.privacy.biometric import is_biometric
from eskin.wire.messages import Gap, Result, Status, decode_message
from eskin.wire.messages.cbor_map import load_any
from eskin.wire.messages.header import require_channel


def is_impersonal(plaintext: bytes) -> bool:
    """Whether bytes are of no channel, or name one that is not biometric; else they may tell.

    Args:
        plaintext: All of what somebody sent, also where it is no message.
    """
    try:
        fields = load_any(plaintext, "message")
        channel = fields.get(4) if isinstance(fields, dict) else None
        if isinstance(channel, str) and not is_biometric(require_channel(channel, "field 4")):
            return True
        return isinstance(decode_message(plaintext), Gap | Status | Result)
    except MessageError:
        return False
