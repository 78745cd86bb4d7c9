"""Why a message is refused."""

from __future__ import annotations

from enum import StrEnum


class RejectReason(StrEnum):
    """Label of counters and logs."""

    TOPIC = "topic"
    OVERSIZED = "oversized"
    MALFORMED = "malformed"
    WRONG_RECIPIENT = "wrong_recipient"
    UNKNOWN_SENDER = "unknown_sender"
    UNTRUSTED = "untrusted"
    FORGED = "forged"
    MISADDRESSED = "misaddressed"
    POISON = "poison"
    FAULT = "fault"
