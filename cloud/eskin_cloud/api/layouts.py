"""Layouts: what a node's frames are read by."""

import re
from typing import Annotated, Final

from fastapi import APIRouter, Query
from starlette.responses import Response

from eskin_cloud.api.dependencies import CloudState, Reader
from eskin_cloud.api.problems import REFUSALS_OF_PLACE
from eskin_cloud.api.responses import as_json
from eskin_cloud.schemas.base import NoQuery
from eskin_cloud.schemas.frames import LayoutDocument, describe_layout
from eskin_cloud.store.descriptions import UnknownDescriptionError, find_stated_layout
from eskin_cloud.store.read.lookup import UnknownChannelError, find_node
from eskin_cloud.store.read.patch_runs import find_layouts

router = APIRouter(tags=["nodes"])

_HASH: Final = re.compile("[0-9a-f]{64}")
_FOR_EVER: Final = {"Cache-Control": "private, max-age=31536000, immutable"}


@router.get(
    "/nodes/{node}/layout",
    response_model=LayoutDocument,
    responses=REFUSALS_OF_PLACE,
)
def get_layout(
    cloud: CloudState, _: Reader, node: str, query: Annotated[NoQuery, Query()]
) -> Response:
    """Read a node's latest layout."""
    del query
    with cloud.store.read() as connection:
        find_node(connection, node)
        known = find_layouts(connection, node)
    if not known:
        raise UnknownChannelError("node", f"{node} states no layout: its channels are no patches")
    return as_json(describe_layout(node, known[0]))


@router.get(
    "/nodes/{node}/layouts/{layout}",
    response_model=LayoutDocument,
    responses=REFUSALS_OF_PLACE,
)
def get_layout_by_hash(
    cloud: CloudState,
    _: Reader,
    node: str,
    layout: str,
    query: Annotated[NoQuery, Query()],
) -> Response:
    """Read one of a node's layouts; it never changes."""
    del query
    name = bytes.fromhex(layout) if _HASH.fullmatch(layout) else b""
    with cloud.store.read() as connection:
        find_node(connection, node)
        try:
            described = find_stated_layout(connection, node, name)
        except UnknownDescriptionError as error:
            raise UnknownChannelError(
                "layout",
                f"{layout} is none of {node}; GET /api/v1/nodes/{node}/layout has the latest",
            ) from error
    answer = as_json(describe_layout(node, described))
    answer.headers.update(_FOR_EVER)
    return answer
