"""Responses: JSON that is written already, and the choice of a media type."""

from __future__ import annotations

from typing import TYPE_CHECKING

from starlette.responses import Response

from eskin_cloud.schemas.base import dump

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence


def as_json(value: Mapping[str, object]) -> Response:
    """An answer in JSON."""
    return Response(dump(value), media_type="application/json")


def choose(accept: str | None, offered: Sequence[str]) -> str | None:
    """The offered media type of the highest quality (RFC 9110, section 12.5.1).

    Of several the first one.

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
