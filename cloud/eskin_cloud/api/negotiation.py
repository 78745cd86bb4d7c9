"""Choosing a format by the ``Accept`` header (RFC 9110, section 12.5.1)."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence


def choose(accept: str | None, offered: Sequence[str]) -> str | None:
    """The offered media type that is liked best; the earlier one where several are.

    Args:
        accept: The header; absent or empty means anything.
        offered: Media types in our own order of preference.

    Returns:
        One of those offered, or ``None`` if none is acceptable.
    """
    if accept is None or not accept.strip():
        return offered[0]
    ranges = [_range(part) for part in accept.split(",") if part.strip()]
    rated = [(_quality(media, ranges), -place, media) for place, media in enumerate(offered)]
    quality, _, best = max(rated)
    return best if quality > 0 else None


def _range(part: str) -> tuple[str, float]:
    name, *parameters = (piece.strip().lower() for piece in part.split(";"))
    for parameter in parameters:
        key, _, value = parameter.partition("=")
        if key.strip() == "q":
            try:
                quality = float(value)
            except ValueError:
                return name, 0.0
            return name, quality if 0.0 <= quality <= 1.0 else 0.0
    return name, 1.0


def _quality(media: str, ranges: Sequence[tuple[str, float]]) -> float:
    group = media.split("/", maxsplit=1)[0]
    for wanted in (media, f"{group}/*", "*/*"):  # the most specific range decides
        found = [quality for name, quality in ranges if name == wanted]
        if found:
            return max(found)
    return 0.0
