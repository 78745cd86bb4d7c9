"""Questions that compare two channels."""

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from itertools import islice
from typing import Annotated, Literal

from fastapi import APIRouter, Query
from pydantic import Field
from sqlalchemy import Connection
from starlette.responses import Response

from eskin.errors import QueryError
from eskin.interval import Verdict
from eskin_cloud.api.dependencies import Access, CloudState, Reader
from eskin_cloud.api.problems import REFUSALS_OF_PLACE
from eskin_cloud.api.responses import as_json
from eskin_cloud.api.window_params import WindowQuery, opened, resumed
from eskin_cloud.app_state import AppState
from eskin_cloud.query.comparison import find_comparison_segments
from eskin_cloud.query.comparison_segments import ComparisonSegment, total_comparison
from eskin_cloud.query.cursors import write_cursor
from eskin_cloud.query.neighbourhood import ChannelSource
from eskin_cloud.schemas.base import PageDocument, Place, page
from eskin_cloud.schemas.comparison import (
    ComparisonSegmentDocument,
    ComparisonTotalsDocument,
    describe_comparison_segment,
    describe_comparison_totals,
)
from eskin_cloud.store.read.lookup import Channel, find_channel, parse_channel
from eskin_cloud.store.read.window import Window, parse_window

router = APIRouter(tags=["series"])


class ComparisonQuery(WindowQuery):
    """Which channel is compared with which; without a window, the last minute that both have."""

    other: Place = Field(max_length=200, description="the other channel, as NODE/CHANNEL")
    state: Literal["above", "below"] = Field(
        default="above", description="whether the channel is asked to be above the other, or below"
    )


class StretchesQuery(ComparisonQuery):
    """Parameters of a comparison's stretches."""

    limit: int = Field(default=1000, ge=1, le=10_000, description="stretches at once")
    cursor: str | None = Field(default=None, max_length=1000, description="what `next` said")


@router.get(
    "/series/{node}/{channel}/comparison",
    response_model=PageDocument[ComparisonSegmentDocument],
    responses=REFUSALS_OF_PLACE,
)
def get_comparison(
    cloud: CloudState,
    access: Reader,
    node: str,
    channel: str,
    query: Annotated[StretchesQuery, Query()],
) -> Response:
    """List when a channel is above or below another one."""
    with cloud.store.read() as connection:
        rows = _rows(connection, node, channel, query)
        window = _window(cloud, rows, query) if query.cursor is None else resumed(query.cursor)
        with _sides(cloud, access, connection, rows, window) as sides:
            found, following = _paged(_stretches(*sides, window, query), window, query.limit)
    return as_json(page([describe_comparison_segment(each) for each in found], following))


@router.get(
    "/series/{node}/{channel}/comparison/time",
    responses=REFUSALS_OF_PLACE,
)
def get_comparison_time(
    cloud: CloudState,
    access: Reader,
    node: str,
    channel: str,
    query: Annotated[ComparisonQuery, Query()],
) -> ComparisonTotalsDocument:
    """Measure how long and how often a channel is above another one."""
    with cloud.store.read() as connection:
        rows = _rows(connection, node, channel, query)
        window = _window(cloud, rows, query)
        with _sides(cloud, access, connection, rows, window) as sides:
            found = total_comparison(_stretches(*sides, window, query))
    unit = sides[0].channel["unit"]
    return describe_comparison_totals(found, window, unit)


def _rows(
    connection: Connection, node: str, channel: str, query: ComparisonQuery
) -> tuple[Channel, Channel]:
    one = find_channel(connection, node, channel)
    return one, find_channel(connection, *parse_channel(query.other, "other"))


def _window(cloud: AppState, rows: tuple[Channel, Channel], query: WindowQuery) -> Window:
    lasts = [row["t_last"] for row in rows if row["t_last"] is not None]
    return parse_window(query.start, query.end, last=min(lasts, default=cloud.clock()))


@contextmanager
def _sides(
    cloud: AppState,
    access: Access,
    connection: Connection,
    rows: tuple[Channel, Channel],
    window: Window,
) -> Iterator[tuple[ChannelSource, ChannelSource]]:
    """Where both are read; what is stored of a sealed one is not what its frames hold.

    Raises:
        QueryError: Their units differ.
    """
    with ExitStack() as stack:
        one, other = (
            ChannelSource(*stack.enter_context(opened(cloud, access, connection, row, window)))
            for row in rows
        )
        _require_same_unit(one.channel, other.channel)
        yield one, other


def _require_same_unit(one: Channel, other: Channel) -> None:
    if one["unit"] != other["unit"]:
        raise QueryError(
            "other",
            f"{other['node']}/{other['channel']} is in {other['unit']}, "
            f"{one['node']}/{one['channel']} in {one['unit']}; compare channels of the same unit",
        )


def _stretches(
    one: ChannelSource, other: ChannelSource, window: Window, query: ComparisonQuery
) -> Iterator[ComparisonSegment]:
    if query.state == "below":
        one, other = other, one
    return find_comparison_segments(one, other, window)


def _paged(
    stretches: Iterator[ComparisonSegment], window: Window, limit: int
) -> tuple[list[ComparisonSegment], str | None]:
    listed = (s for s in stretches if s.answer in {Verdict.CERTAIN, Verdict.POSSIBLE})
    found = list(islice(listed, limit))
    following = next(listed, None)
    return found, None if following is None else write_cursor(following.start, window.end)
