"""Pictures of a skin, in the format that is asked for."""

from functools import partial
from typing import Annotated

from fastapi import APIRouter, Header, Query
from pydantic import Field
from starlette.responses import Response

from eskin.runtime.http_server.problems import ProblemError, documented
from eskin_cloud.api.dependencies import CloudState, Reader
from eskin_cloud.api.picture_formats import WRITERS
from eskin_cloud.api.problems import REFUSALS_OF_PLACE
from eskin_cloud.api.responses import choose
from eskin_cloud.api.window_params import WindowQuery
from eskin_cloud.privacy.decrypted_window import SealedPage, decrypted_frames
from eskin_cloud.query.pictures import find_sealed, read_pictures
from eskin_cloud.schemas.frames import PicturesDocument
from eskin_cloud.store.read.lookup import find_node
from eskin_cloud.store.read.patch_runs import find_last
from eskin_cloud.store.read.window import parse_window

router = APIRouter(tags=["nodes"])


class PicturesQuery(WindowQuery):
    """Parameters of pictures."""

    points: int = Field(default=100, ge=1, le=2000, description="most pictures")
    quantity: str | None = Field(
        default=None,
        max_length=31,
        description="such as capacitance; else pressure, or the first patch's where there is none",
    )
    own: bool = Field(
        default=False,
        description="only what the node itself samples, of a skin that several nodes share",
    )


@router.get(
    "/nodes/{node}/frames",
    response_model=PicturesDocument,
    responses={
        200: {"content": {media: {} for media in WRITERS if media != "application/json"}},
        **REFUSALS_OF_PLACE,
        **documented(406),
    },
)
def get_frames(
    cloud: CloudState,
    access: Reader,
    node: str,
    query: Annotated[PicturesQuery, Query()],
    accept: Annotated[str | None, Header(include_in_schema=False)] = None,
) -> Response:
    """Read pictures of a node's whole skin.

    Each is the hull of all samples in its stretch of time, and lasts 1.5 sampling periods at least.
    Biometric channels are unknown to a caller without the scope `biometric`.
    """
    media = choose(accept, tuple(WRITERS))
    if media is None:
        raise ProblemError(406, f"{accept!r} is not offered; accept one of {', '.join(WRITERS)}")
    with cloud.store.read() as connection:
        find_node(connection, node)
        scopes = access.holder.scopes
        may = cloud.key_access.may(scopes)
        last = find_last(connection, node, sealed=may)
        window = parse_window(query.start, query.end, last=cloud.clock() if last is None else last)
        ask = partial(
            read_pictures,
            connection,
            node,
            window,
            points=query.points,
            quantity=query.quantity,
            own=query.own,
        )
        sealed = find_sealed(connection, node, window, query.quantity) if may else []
        if sealed:
            reader = cloud.key_access.reader(scopes, connection, access.opened)
            places = [SealedPage(*place) for place in sealed]
            with decrypted_frames(connection, reader, node, places, window) as memory:
                pictures = ask(decrypted=memory)
        else:
            pictures = ask()
    return Response(WRITERS[media](pictures), media_type=media, headers={"Vary": "Accept"})
