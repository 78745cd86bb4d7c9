"""Cursors of paged lists, opaque to the client."""

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
        QueryError: The cursor is invalid.
    """
    try:
        padded = cursor + "=" * (-len(cursor) % 4)
        parts = base64.b64decode(padded, altchars=b"-_", validate=True).decode().split("\n")
    except (binascii.Error, ValueError) as error:
        raise invalid_cursor() from error
    if len(parts) != count:
        raise invalid_cursor()
    return parts


def read_numbers(cursor: str, count: int) -> list[int]:
    """Read a cursor of ``count`` 64-bit integers.

    Raises:
        QueryError: The cursor is invalid.
    """
    try:
        numbers = [int(part) for part in read_texts(cursor, count)]
    except ValueError as error:
        raise invalid_cursor() from error
    if any(abs(number) >= 2**63 for number in numbers):
        raise invalid_cursor()
    return numbers


def invalid_cursor() -> QueryError:
    """The error for a cursor that this cloud did not issue."""
    return QueryError("cursor", "is invalid; pass the `next` of an earlier answer, or leave it out")
