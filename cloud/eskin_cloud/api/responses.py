"""Answers that are written already."""

from __future__ import annotations

from typing import TYPE_CHECKING

from starlette.responses import Response

from eskin_cloud.schemas.shapes import dump

if TYPE_CHECKING:
    from eskin_cloud.schemas.shapes import Json


def as_json(value: Json) -> Response:
    """An answer in JSON."""
    return Response(dump(value), media_type="application/json")
