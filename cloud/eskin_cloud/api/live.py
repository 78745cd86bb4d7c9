"""The live stream."""

import asyncio
from typing import Annotated, Final

from fastapi import APIRouter, Header, Query
from pydantic import BaseModel, ConfigDict, Field
from starlette.responses import Response, StreamingResponse
from starlette.types import Receive, Scope, Send

from eskin.errors import QueryError
from eskin.privacy import is_biometric
from eskin.runtime.http_server.problems import ProblemError
from eskin.runtime.http_server.protocol import PROMPT
from eskin_cloud.access import Scope as AccessScope
from eskin_cloud.api.dependencies import CloudState, Reader
from eskin_cloud.api.problems import REFUSALS_OF_PLACE
from eskin_cloud.app_state import AppState
from eskin_cloud.live.stream import stream
from eskin_cloud.live.subscription import Subscription
from eskin_cloud.store.read.lookup import find_node, parse_channel

router = APIRouter(tags=["live"])

_MEDIA_TYPE: Final = "text/event-stream"


class LiveQuery(BaseModel):
    """Parameters of the live stream."""

    model_config = ConfigDict(extra="forbid")

    node: list[str] = Field(default=[], max_length=1000, description="these only")
    channel: list[str] = Field(
        default=[], max_length=1000, description="these only, each NODE/CHANNEL"
    )
    points: int = Field(
        default=50, ge=1, le=1000, description="entries that a block is reduced to at most"
    )
    grain: int = Field(
        default=0,
        ge=0,
        le=10**18,
        description="ns: entries need be no finer; 0: as fine as `points` lets them be",
    )


class EventStream(StreamingResponse):
    """Server-sent events, sent with as little buffering as possible."""

    media_type = _MEDIA_TYPE

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer without delaying buffers of the connection."""
        if prompt := scope.get("extensions", {}).get(PROMPT):
            prompt["begin"]()
        await super().__call__(scope, receive, send)


@router.get(
    "/live",
    response_class=EventStream,
    responses={
        200: {"description": "server-sent events: block, peak, gap, status, command, lagging"},
        **REFUSALS_OF_PLACE,
    },
)
async def get_live(
    cloud: CloudState,
    reader: Reader,
    query: Annotated[LiveQuery, Query()],
    last_event_id: Annotated[
        str | None, Header(max_length=100, description="where to go on: the last `id`")
    ] = None,
) -> Response:
    """Stream what is stored, as it arrives.

    Resumes after ``Last-Event-ID`` without gaps.
    """
    feed, live = cloud.feed, cloud.settings.live
    cursor = _cursor(cloud, last_event_id)
    selection = Subscription(
        frozenset(query.node),
        frozenset(parse_channel(text) for text in query.channel),
        query.points,
        query.grain,
    )
    await asyncio.to_thread(_require_known, cloud, selection)
    if any(is_biometric(channel) for _, channel in selection.channels):
        cloud.key_access.require(reader.holder.scopes)
    if feed.subscribers >= live.subscribers:
        raise ProblemError(503, f"{feed.subscribers} streams are open already; try again later")
    events = stream(
        feed,
        selection,
        viewers=cloud.viewers,
        cursor=cursor,
        backlog=live.backlog,
        heartbeat=live.heartbeat_s,
        reveal=cloud.key_access.reveal(reader.holder.scopes),
        sealed=AccessScope.BIOMETRIC in reader.holder.scopes,
    )
    return EventStream(events, headers={"X-Accel-Buffering": "no"})


def _require_known(cloud: AppState, selection: Subscription) -> None:
    if selection.looked_at:
        with cloud.store.read() as connection:
            for node in sorted(selection.looked_at):
                find_node(connection, node)


def _cursor(cloud: AppState, text: str | None) -> int:
    last = cloud.feed.last
    if text is None or not text:
        return last
    try:
        (cursor,) = cloud.feed.ids.read(text, 1)
    except QueryError as error:
        raise QueryError(
            "Last-Event-ID", f"{text!r} is no id of this stream; leave it out"
        ) from error
    return min(cursor, last)
