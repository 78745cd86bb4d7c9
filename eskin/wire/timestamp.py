"""Instants: UTC as integer nanoseconds since 1970, and their RFC 3339 text.

``datetime`` stops at microseconds, so the nanoseconds are kept beside it.
"""

from __future__ import annotations

import re
from datetime import UTC, datetime
from functools import lru_cache

SECOND = 1_000_000_000

EARLIEST = -62_135_596_800 * SECOND
"""0001-01-01T00:00:00Z, the first instant that RFC 3339 can write here."""
LATEST = 253_402_300_800 * SECOND - 1
"""The last nanosecond of year 9999."""
MOST_INSTANT = 2**63 - 1
"""The last instant that messages and the store hold; the first is its negative.

Also the most ns that a node's clock counts since its start.
"""

_RFC3339 = re.compile(
    r"(\d{4}-\d{2}-\d{2})[Tt ](\d{2}:\d{2}:\d{2})(?:\.(\d{1,9}))?([Zz]|[+-]\d{2}:\d{2})"
)


def format_timestamp(nanoseconds: int) -> str:
    """Write an instant as RFC 3339 with nine digits and ``Z``.

    Args:
        nanoseconds: UTC, ns since 1970-01-01.

    Returns:
        Such as ``2026-01-31T12:00:00.000000001Z``.

    Raises:
        ValueError: Outside of years 1 to 9999.
    """
    if not EARLIEST <= nanoseconds <= LATEST:
        raise ValueError(f"{nanoseconds} ns is outside of the years 1 to 9999")
    seconds, fraction = divmod(nanoseconds, SECOND)
    minutes, second = divmod(seconds, 60)
    return f"{_minute(minutes)}:{second:02d}.{fraction:09d}Z"


@lru_cache(4096)
def _minute(minutes: int) -> str:
    """Date, hour and minute: many instants share them."""
    days, in_day = divmod(minutes, 1_440)
    date = datetime.fromordinal(719_163 + days)
    day = f"{date.year:04d}-{date.month:02d}-{date.day:02d}"
    return f"{day}T{in_day // 60:02d}:{in_day % 60:02d}"


def parse_timestamp(text: str) -> int:
    """Read RFC 3339 (section 5.6) or an integer count of nanoseconds since 1970.

    Args:
        text: Such as ``2026-01-31T12:00:00Z`` or ``1769860800000000000``.

    Returns:
        UTC, ns since 1970-01-01.

    Raises:
        ValueError: The text is neither, or lies outside of years 1 to 9999.
    """
    if re.fullmatch(r"[+-]?\d{1,20}", text):
        nanoseconds = int(text)
    else:
        found = _RFC3339.fullmatch(text)
        if found is None:
            raise ValueError(
                f"{text!r} is no time; write RFC 3339 such as 2026-01-31T12:00:00Z, "
                "or integer nanoseconds since 1970"
            )
        date, clock, fraction, zone = found.groups()
        whole = datetime.fromisoformat(f"{date}T{clock}{'+00:00' if zone in 'Zz' else zone}")
        since = whole - datetime(1970, 1, 1, tzinfo=UTC)
        nanoseconds = (since.days * 86_400 + since.seconds) * SECOND
        nanoseconds += int((fraction or "").ljust(9, "0"))
    if not EARLIEST <= nanoseconds <= LATEST:
        raise ValueError(f"{text!r} is outside of the years 1 to 9999")
    return nanoseconds
