"""Nodes and their channels."""

from collections.abc import Sequence
from typing import Annotated

from fastapi import APIRouter, Query
from pydantic import BaseModel, ConfigDict, Field
from sqlalchemy import RowMapping
from starlette.responses import Response

from eskin.wire.timestamp import SECOND
from eskin_cloud.api.dependencies import CloudState, Reader
from eskin_cloud.api.problems import REFUSALS, REFUSALS_OF_PLACE
from eskin_cloud.api.responses import as_json
from eskin_cloud.app_state import AppState
from eskin_cloud.query.listing import count_channels, list_channels, list_nodes, list_removed
from eskin_cloud.schemas.base import NoQuery, PageDocument, page
from eskin_cloud.schemas.nodes import (
    ChannelDocument,
    NodeDocument,
    describe_channel,
    describe_node,
    judge_health,
)
from eskin_cloud.store.read.lookup import find_node
from eskin_cloud.store.write.missing_messages import MissingSpan, list_missing

router = APIRouter(tags=["nodes"])


class ListQuery(BaseModel):
    """Parameters of a list."""

    model_config = ConfigDict(extra="forbid")

    cursor: str | None = Field(default=None, max_length=1000, description="the value of `next`")


class ChannelsQuery(ListQuery):
    """Parameters of a list of channels."""

    quantity: str | None = Field(
        default=None, max_length=31, description="whose channels are listed, such as pressure"
    )
    text: str | None = Field(
        default=None,
        max_length=63,
        description="what a channel's name contains, in upper or lower case",
    )


@router.get("/nodes", response_model=PageDocument[NodeDocument], responses=REFUSALS)
def get_nodes(cloud: CloudState, access: Reader, query: Annotated[ListQuery, Query()]) -> Response:
    """List the nodes, by name."""
    ids = cloud.feed.ids
    after = "" if query.cursor is None else ids.read_name(query.cursor)
    with cloud.store.read() as connection:
        rows, following = list_nodes(connection, after)
        names = [row["node"] for row in rows]
        counts, holes = count_channels(connection, names), list_missing(connection, names)
        sealed = access.uncounted(connection, names)
    items = [
        _node(
            cloud,
            row,
            counts[row["node"]],
            holes[row["node"]],
            counted=row["node"] not in sealed,
        )
        for row in rows
    ]
    return as_json(page(items, None if following is None else ids.write_name(following)))


@router.get("/nodes/{node}", response_model=NodeDocument, responses=REFUSALS_OF_PLACE)
def get_node(
    cloud: CloudState, access: Reader, node: str, query: Annotated[NoQuery, Query()]
) -> Response:
    """Read one node."""
    del query
    with cloud.store.read() as connection:
        row = find_node(connection, node)
        counts, holes = count_channels(connection, [node]), list_missing(connection, [node])
        counted = not access.uncounted(connection, [node])
    return as_json(_node(cloud, row, counts[node], holes[node], counted=counted))


@router.get(
    "/nodes/{node}/channels",
    response_model=PageDocument[ChannelDocument],
    responses=REFUSALS_OF_PLACE,
)
def get_channels(
    cloud: CloudState, access: Reader, node: str, query: Annotated[ChannelsQuery, Query()]
) -> Response:
    """List a node's channels, by name.

    All, or those of a quantity, or those whose name contains a text.
    """
    ids = cloud.feed.ids
    after = "" if query.cursor is None else ids.read_name(query.cursor)
    with cloud.store.read() as connection:
        find_node(connection, node)
        rows, following = list_channels(
            connection, node, after, quantity=query.quantity, text=query.text
        )
        gone = list_removed(connection, node)
        counted = not access.uncounted(connection, [node])
    items = [describe_channel(row, gone.get(row["patch"]), counted=counted) for row in rows]
    return as_json(page(items, None if following is None else ids.write_name(following)))


def _node(
    cloud: AppState,
    row: RowMapping,
    channels: int | None,
    holes: Sequence[MissingSpan],
    *,
    counted: bool,
) -> NodeDocument:
    silence = (cloud.clock() - row["last_seen"]) / SECOND
    health = judge_health(cloud.settings.nodes, silence, ahead=-silence)
    return describe_node(
        row,
        channels=channels,
        health=health,
        clock_error_s=cloud.settings.nodes.clock_error_s,
        # They name sequence numbers.
        holes=holes if counted else (),
        counted=counted,
    )
