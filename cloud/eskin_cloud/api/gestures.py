"""The gestures on a node's skin in a window."""

from typing import Annotated, Literal

from fastapi import APIRouter, Query
from pydantic import Field
from starlette.responses import Response

from eskin.gestures import Kind
from eskin_cloud.api.dependencies import CloudState, Reader
from eskin_cloud.api.problems import REFUSALS_OF_PLACE
from eskin_cloud.api.responses import as_json
from eskin_cloud.api.window_params import WindowQuery
from eskin_cloud.query.gestures import GestureSkin
from eskin_cloud.schemas.base import PageDocument, page
from eskin_cloud.schemas.gestures import GestureDocument, describe_gesture
from eskin_cloud.store.read.window import parse_window

router = APIRouter(tags=["contacts"])


class GesturesQuery(WindowQuery):
    """Parameters of gestures."""

    kind: Kind | None = Field(default=None, description="only these")
    verdict: Literal["possible", "certain"] | None = Field(
        default=None, description="only these; all others are impossible"
    )


@router.get(
    "/nodes/{node}/gestures",
    responses={200: {"model": PageDocument[GestureDocument]}, **REFUSALS_OF_PLACE},
)
def get_gestures(
    cloud: CloudState, _: Reader, node: str, query: Annotated[GesturesQuery, Query()]
) -> Response:
    """Find the gestures on a node's skin.

    One node must sample all of it. Gestures come in the order of their ends. The record begins and
    ends with the window: what a touch that it cuts makes is possible at most. The node's latest
    layout counts. Biometric patches are not read: they may be touched or not.
    """
    with cloud.store.read() as connection:
        skin = GestureSkin(connection, node)
        last = cloud.clock() if skin.last is None else skin.last
        found = skin.find(parse_window(query.start, query.end, last=last))
    return as_json(
        page(
            [
                describe_gesture(each)
                for each in found
                if query.kind in {None, each.kind}
                and query.verdict in {None, each.verdict.name.lower()}
            ],
            None,
        )
    )
