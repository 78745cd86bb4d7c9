"""Series of a channel, in the format that is asked for, and questions for thresholds."""

from typing import Annotated

from fastapi import APIRouter, Header, Query
from pydantic import Field
from starlette.responses import Response

from eskin.runtime.http_server.problems import ProblemError, documented
from eskin_cloud.api.dependencies import CloudState, Reader
from eskin_cloud.api.problems import REFUSALS_OF_PLACE
from eskin_cloud.api.responses import choose
from eskin_cloud.api.series_formats import WRITERS
from eskin_cloud.api.window_params import WindowQuery, opened, window_of
from eskin_cloud.query.series import read_series
from eskin_cloud.rollup.hulls import widest_window
from eskin_cloud.schemas.series import (
    SeriesDocument,
)
from eskin_cloud.store.read.lookup import find_channel

router = APIRouter(tags=["series"])


class SeriesQuery(WindowQuery):
    """Parameters of a series."""

    points: int = Field(
        default=1000,
        ge=1,
        le=20_000,
        description="samples that are answered as they are; where there are more, buckets",
    )


@router.get(
    "/series/{node}/{channel}",
    response_model=SeriesDocument,
    responses={
        200: {"content": {media: {} for media in WRITERS if media != "application/json"}},
        **REFUSALS_OF_PLACE,
        **documented(406),
    },
)
def get_series(
    cloud: CloudState,
    access: Reader,
    node: str,
    channel: str,
    query: Annotated[SeriesQuery, Query()],
    accept: Annotated[str | None, Header(include_in_schema=False)] = None,
) -> Response:
    """Read a window of a channel.

    It holds all samples, or where they are more than ``points``, the hulls of buckets.
    """
    media = choose(accept, tuple(WRITERS))
    if media is None:
        raise ProblemError(406, f"{accept!r} is not offered; accept one of {', '.join(WRITERS)}")
    with cloud.store.read() as connection:
        row = find_channel(connection, node, channel)
        window = window_of(cloud, row, query)
        with opened(cloud, access, connection, row, widest_window(window)) as (source, known):
            series = read_series(source, known, window, points=query.points)
    return Response(WRITERS[media](series), media_type=media, headers={"Vary": "Accept"})
