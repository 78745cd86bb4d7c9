"""Series of a channel, in the format that is asked for, and questions for thresholds."""

from typing import Annotated, Self

from fastapi import APIRouter, Header, Query
from pydantic import Field, model_validator
from starlette.responses import Response

from eskin.errors import QueryError
from eskin.runtime.http_server.problems import ProblemError, documented
from eskin_cloud.api.dependencies import CloudState, Reader
from eskin_cloud.api.problems import REFUSALS_OF_PLACE
from eskin_cloud.api.responses import as_json, choose
from eskin_cloud.api.series_formats import WRITERS
from eskin_cloud.api.window_params import WindowQuery, opened, paged, resumed, window_of
from eskin_cloud.query.occupancy import measure_occupancy
from eskin_cloud.query.predicate import Predicate
from eskin_cloud.query.segments import find_segments
from eskin_cloud.query.series import read_series
from eskin_cloud.rollup.hulls import widest_window
from eskin_cloud.schemas.base import PageDocument, page
from eskin_cloud.schemas.series import (
    OccupancyDocument,
    SegmentDocument,
    SeriesDocument,
    describe_occupancy,
    describe_segment,
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


class StateQuery(WindowQuery):
    """Which state is asked for: above or below a value, or in a band, its ends included."""

    above: float | None = Field(default=None, allow_inf_nan=False, description="in the unit")
    below: float | None = Field(default=None, allow_inf_nan=False, description="in the unit")
    at_least: float | None = Field(default=None, allow_inf_nan=False, description="of a band")
    at_most: float | None = Field(default=None, allow_inf_nan=False, description="of a band")
    outside: bool = Field(default=False, description="asks for outside of the band instead")

    @model_validator(mode="after")
    def _one_state(self) -> Self:
        band = self.at_least is not None, self.at_most is not None
        if (self.above is not None) + (self.below is not None) + any(band) != 1:
            raise QueryError(
                "above, below", "give either above or below, or at_least and at_most for a band"
            )
        if any(band) and not all(band):
            raise QueryError("at_least, at_most", "give both ends of the band")
        if self.outside and not all(band):
            raise QueryError("outside", "needs a band: give at_least and at_most, too")
        if self.at_least is not None and self.at_most is not None and self.at_least > self.at_most:
            raise QueryError("at_least", "is greater than at_most; swap them")
        return self

    @property
    def question(self) -> Predicate:
        """The question."""
        if self.at_least is not None:
            return Predicate(self.at_least, self.at_most, outside=self.outside)
        return Predicate(self.above, self.below, strict=True)


class ThresholdQuery(StateQuery):
    """Parameters of a threshold."""

    limit: int = Field(default=1000, ge=1, le=10_000, description="segments at once")
    cursor: str | None = Field(default=None, max_length=1000, description="what `next` said")


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


@router.get(
    "/series/{node}/{channel}/threshold",
    response_model=PageDocument[SegmentDocument],
    responses=REFUSALS_OF_PLACE,
)
def get_threshold(
    cloud: CloudState,
    access: Reader,
    node: str,
    channel: str,
    query: Annotated[ThresholdQuery, Query()],
) -> Response:
    """List when a channel is above, below or within values."""
    with cloud.store.read() as connection:
        row = find_channel(connection, node, channel)
        # A cursor holds the window, too: new data must not move a default one.
        window = window_of(cloud, row, query) if query.cursor is None else resumed(query.cursor)
        with opened(cloud, access, connection, row, window) as (source, known):
            segments = find_segments(source, known, window, query.question)
            found, following = paged(segments, window, query.limit)
    return as_json(page([describe_segment(segment) for segment in found], following))


@router.get("/series/{node}/{channel}/time", responses=REFUSALS_OF_PLACE)
def get_time(
    cloud: CloudState,
    access: Reader,
    node: str,
    channel: str,
    query: Annotated[StateQuery, Query()],
) -> OccupancyDocument:
    """Measure how long and how often a channel is in a state."""
    with cloud.store.read() as connection:
        row = find_channel(connection, node, channel)
        window = window_of(cloud, row, query)
        with opened(cloud, access, connection, row, window) as (source, known):
            found = measure_occupancy(source, known, window, query.question)
    return describe_occupancy(found, window, known)
