"""Answers that are written already."""

from __future__ import annotations

from typing import TYPE_CHECKING

from starlette.responses import Response

from cloud.shapes import dump

if TYPE_CHECKING:
    from cloud.shapes import Json


def as_json(value: Json) -> Response:
    """An answer in JSON."""
    return Response(dump(value), media_type="application/json")
