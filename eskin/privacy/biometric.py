"""Which channels are biometric, and which messages may be."""

from __future__ import annotations

from functools import lru_cache
from typing import Final

from eskin.errors import MessageError
from eskin.wire.messages import Gap, Result, Status, decode_message
from eskin.wire.messages.cbor_map import load_any
from eskin.wire.messages.header import require_channel

BIOMETRIC: Final = frozenset({"bioelectric"})
"""Biometric quantities."""
MARK: Final = "bio-"
"""Prefix of the ids of taxels that are biometric whatever they measure."""


@lru_cache(4096)
def is_biometric(channel: str) -> bool:
    """Whether a channel is biometric: never public, and encrypted at rest.

    Its name alone says so: it comes with every message, so that no two tiers can disagree.

    Args:
        channel: ``{taxel}.{quantity}``.
    """
    return channel.startswith(MARK) or channel.rpartition(".")[2] in BIOMETRIC


def is_not_biometric(plaintext: bytes) -> bool:
    """Whether bytes are certainly not biometric: of no channel, or of one that is not.

    Args:
        plaintext: The whole payload, whether or not it is a message.
    """
    try:
        fields = load_any(plaintext, "message")
        channel = fields.get(4) if isinstance(fields, dict) else None
        if isinstance(channel, str) and not is_biometric(require_channel(channel, "field 4")):
            return True
        return isinstance(decode_message(plaintext), Gap | Status | Result)
    except MessageError:
        return False
