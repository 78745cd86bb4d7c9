"""Events: peaks, gaps, contacts, verdicts, answered commands, changes of a node's status."""

from typing import Annotated, Literal

from fastapi import APIRouter, Query
from pydantic import BaseModel, ConfigDict, Field
from starlette.responses import Response

from eskin.privacy import is_biometric
from eskin_cloud.api.dependencies import CloudState, Reader
from eskin_cloud.api.problems import REFUSALS_OF_PLACE
from eskin_cloud.api.responses import as_json
from eskin_cloud.privacy.sealed_events import find_sealed_events
from eskin_cloud.query.events import EventQuery, find_events
from eskin_cloud.schemas.base import TIME, PageDocument, Time, page
from eskin_cloud.schemas.events import EventDocument, EventKind, describe_event
from eskin_cloud.store.read.lookup import find_node
from eskin_cloud.store.read.window import parse_time, require_ordered

router = APIRouter(tags=["events"])


class EventsQuery(BaseModel):
    """Parameters of the list of events."""

    model_config = ConfigDict(extra="forbid")

    node: str | None = Field(default=None, max_length=100, description="of this node only")
    channel: str | None = Field(default=None, max_length=100, description="of this channel only")
    kind: EventKind | None = Field(default=None, description="only these")
    verdict: Literal["certain", "possible", "impossible"] | None = Field(
        default=None, description="only these"
    )
    start: Time | None = Field(default=None, description=f"not over before; {TIME}")
    end: Time | None = Field(default=None, description=f"begun before; {TIME}")
    limit: int = Field(default=100, ge=1, le=1000, description="events at once")
    cursor: str | None = Field(default=None, max_length=1000, description="the value of `next`")
    order: Literal["asc", "desc"] = Field(default="desc", description="by time; desc: latest first")


@router.get("/events", response_model=PageDocument[EventDocument], responses=REFUSALS_OF_PLACE)
def get_events(
    cloud: CloudState, access: Reader, query: Annotated[EventsQuery, Query()]
) -> Response:
    """List events that overlap a window."""
    scopes = access.holder.scopes
    if query.channel is not None and is_biometric(query.channel):
        cloud.key_access.require(scopes)
    start, end = parse_time("start", query.start), parse_time("end", query.end)
    require_ordered(start, end)
    ids = cloud.feed.ids
    cursor = None
    if query.cursor is not None:
        t, place, number = ids.read(query.cursor, 3)
        cursor = t, place, number
    question = EventQuery(
        node=query.node,
        channel=query.channel,
        kind=query.kind,
        verdict=query.verdict,
        start=start,
        end=end,
        limit=query.limit,
        cursor=cursor,
        order=query.order,
    )
    with cloud.store.read() as connection:
        may = cloud.key_access.may(scopes)
        reader = cloud.key_access.reader(scopes, connection, access.opened) if may else None
        if query.node is not None:
            find_node(connection, query.node)
        opened = [] if reader is None else find_sealed_events(connection, reader, question)
        rows, following = find_events(connection, question, opened)
    answer = [describe_event(row, ids) for row in rows]
    return as_json(page(answer, None if following is None else ids.write(*following)))
