"""Which messages may be biometric."""

from __future__ import annotations

from typing import Final

from eskin.errors import MessageError
from eskin.wire.biometric import is_biometric
from eskin.wire.messages import Gap, Result, Status, decode_message
from eskin.wire.messages.cbor_map import load_any
from eskin.wire.messages.header import Kind, require_channel

_OF_FRAMES: Final = frozenset({Kind.FRAME, Kind.STATEMENTS, Kind.PATCH, Kind.LAYOUT})
"""No channel stands in field 4 of these."""


def is_not_biometric(plaintext: bytes) -> bool:
    """Whether bytes are certainly not biometric: of no channel, or of one that is not.

    Args:
        plaintext: The whole payload, whether or not it is a message.
    """
    try:
        fields = load_any(plaintext, "message")
        if not isinstance(fields, dict) or fields.get(1) in _OF_FRAMES:
            return False
        channel = fields.get(4)
        if isinstance(channel, str) and not is_biometric(require_channel(channel, "field 4")):
            return True
        return isinstance(decode_message(plaintext), Gap | Status | Result)
    except MessageError:
        return False
