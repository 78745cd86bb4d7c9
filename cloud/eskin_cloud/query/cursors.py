"""Cursors: where a list goes on, opaque to the one who asks."""

from __future__ import annotations

import base64
import binascii

from eskin.errors import QueryError


def write_cursor(*parts: int | str) -> str:
    """Write a cursor."""
    text = "\n".join(str(part) for part in parts)
    return base64.urlsafe_b64encode(text.encode()).decode().rstrip("=")


def read_texts(cursor: str, count: int) -> list[str]:
    """Read a cursor of ``count`` texts.

    Raises:
        QueryError: It is none of ours.
    """
    try:
        padded = cursor + "=" * (-len(cursor) % 4)
        parts = base64.b64decode(padded, altchars=b"-_", validate=True).decode().split("\n")
    except (binascii.Error, ValueError) as error:
        raise _refusal() from error
    if len(parts) != count:
        raise _refusal()
    return parts


def read_numbers(cursor: str, count: int) -> list[int]:
    """Read a cursor of ``count`` integers of 64 bit.

    Raises:
        QueryError: It is none of ours.
    """
    try:
        numbers = [int(part) for part in read_texts(cursor, count)]
    except ValueError as error:
        raise _refusal() from error
    if any(abs(number) >= 2**63 for number in numbers):
        raise _refusal()
    return numbers


def _refusal() -> QueryError:
    return QueryError("cursor", "is none of ours; pass on what `next` said, or leave it out")
