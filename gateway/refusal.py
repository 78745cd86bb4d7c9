"""What a cloud's refusal says: its status, and for how long it asks for patience."""

from __future__ import annotations

from email.utils import parsedate_to_datetime
from time import time

import httpx

from eskin.errors import CloudError


def require_ok(answer: httpx.Response) -> None:
    """Go on only with an answer of status 200; its body need not have been read.

    Raises:
        CloudError: It has another status.
    """
    if answer.status_code == httpx.codes.OK:
        return
    raise CloudError(
        f"{answer.url} answered {answer.status_code} {answer.reason_phrase}",
        status=answer.status_code,
        retry_after=_patience(answer.headers.get("Retry-After")),
    )


def _patience(value: str | None) -> float | None:
    """Seconds of a Retry-After: a number, or a date (RFC 9110, section 10.2.3)."""
    if value is None:
        return None
    if value.isascii() and value.isdigit():
        return float(value[:9])
    try:
        return max(0.0, parsedate_to_datetime(value).timestamp() - time())
    except (ValueError, OverflowError):
        return None
