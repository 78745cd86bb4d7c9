"""The live stream."""

import asyncio
import contextlib
from collections.abc import Collection
from typing import Annotated, Final

from fastapi import APIRouter, Header, Query, WebSocket, WebSocketDisconnect
from pydantic import BaseModel, ConfigDict, Field, ValidationError
from starlette.responses import Response, StreamingResponse
from starlette.types import Receive, Scope, Send

from eskin.errors import EskinError, StoreError, unprefixed
from eskin.privacy import is_biometric
from eskin.runtime.http_server.problems import ProblemError
from eskin.runtime.http_server.protocol import PROMPT
from eskin_cloud.access import Scope as AccessScope
from eskin_cloud.api.dependencies import CloudState, Reader, Viewer
from eskin_cloud.api.problems import REFUSALS_OF_PLACE
from eskin_cloud.app_state import AppState
from eskin_cloud.live.entry_reader import EntryReader
from eskin_cloud.live.frame_encoder import FrameSelection
from eskin_cloud.live.frame_stream import FrameStream
from eskin_cloud.live.sse_encoder import Subscription
from eskin_cloud.live.stream import stream
from eskin_cloud.query.opaque_ids import UnknownCursorError
from eskin_cloud.store.feed_entry import FeedPosition
from eskin_cloud.store.read.lookup import find_node, parse_channel

router = APIRouter(tags=["live"])

_MEDIA_TYPE: Final = "text/event-stream"
MOST_MESSAGE_BYTES: Final = 4096
"""Length of a client's message on a WebSocket."""
_RESTARTING, _UNSUPPORTED, _INVALID, _REFUSED, _FAILED = 1012, 1003, 1007, 1008, 1013
"""Codes with which a WebSocket is closed (RFC 6455, section 7.4, and IANA's registry)."""
_UNKNOWN_CURSOR: Final = 4422
"""Of the range for private use."""
_LONGEST_REASON: Final = 100
"""In characters; a close frame holds 123 bytes."""


class LiveQuery(BaseModel):
    """Parameters of the live stream."""

    model_config = ConfigDict(extra="forbid")

    node: list[str] = Field(default=[], max_length=1000, description="these only")
    channel: list[str] = Field(
        default=[], max_length=1000, description="these only, each NODE/CHANNEL"
    )
    points: int = Field(
        default=1,
        ge=1,
        le=1000,
        description="hulls that the rows of a patch become at most, of each frame",
    )


class FramesQuery(BaseModel):
    """Parameters of a WebSocket."""

    model_config = ConfigDict(extra="forbid")

    node: list[str] = Field(default=[], max_length=1000)
    cursor: str | None = Field(default=None, max_length=1000)


class SelectionMessage(BaseModel):
    """What a client asks for on its WebSocket; ``null`` stands for all."""

    model_config = ConfigDict(extra="forbid", strict=True)

    nodes: list[str] | None = None
    patches: list[str] | None = None

    @property
    def selection(self) -> FrameSelection:
        """The same for a stream."""
        nodes, patches = self.nodes, self.patches
        return FrameSelection(
            None if nodes is None else frozenset(nodes),
            None if patches is None else frozenset(patches),
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
        101: {"description": "a WebSocket, where one was asked for: docs/rest.md, *Live frames*"},
        200: {"description": "server-sent events: frame, peak, gap, status, command, lagging"},
        **REFUSALS_OF_PLACE,
    },
)
async def get_live(
    cloud: CloudState,
    reader: Reader,
    query: Annotated[LiveQuery, Query()],
    last_event_id: Annotated[
        str | None, Header(max_length=1000, description="where to go on: the last `id`")
    ] = None,
) -> Response:
    """Stream what is stored, as it arrives.

    Resumes after ``Last-Event-ID`` without gaps. A request to upgrade to a WebSocket, with ``node``
    and ``cursor`` as its parameters, is answered with frames in CBOR, as their nodes encoded them.
    """
    feed, live = cloud.feed, cloud.settings.live
    position = await resume(cloud, last_event_id, "Last-Event-ID")
    selection = Subscription(
        frozenset(query.node),
        frozenset(parse_channel(text) for text in query.channel),
        query.points,
    )
    await asyncio.to_thread(_require_known, cloud, selection.looked_at)
    if any(is_biometric(channel) for _, channel in selection.channels):
        cloud.key_access.require(reader.holder.scopes)
    _require_room(cloud)
    events = stream(
        feed,
        selection,
        position=position,
        backlog=live.backlog,
        heartbeat=live.heartbeat_s,
        reader=EntryReader(cloud.key_access, reader.holder.scopes, feed.layouts, cloud.store),
        sealed=AccessScope.BIOMETRIC in reader.holder.scopes,
    )
    return EventStream(events, headers={"X-Accel-Buffering": "no"})


@router.websocket("/live")
async def watch_live(
    websocket: WebSocket,
    cloud: CloudState,
    viewer: Viewer,
    query: Annotated[FramesQuery, Query()],
) -> None:
    """Stream frames, events and contacts as they are stored, in CBOR."""
    live, scopes = cloud.settings.live, viewer.holder.scopes
    try:
        position = await resume(cloud, query.cursor, "cursor")
    except UnknownCursorError as error:
        # A browser shows its page the code of a close, and not the status of a refused upgrade.
        await websocket.accept()
        await _close(websocket, (_UNKNOWN_CURSOR, str(error)))
        return
    nodes = frozenset(query.node)
    await asyncio.to_thread(_require_known, cloud, nodes)
    _require_room(cloud)
    frames = FrameStream(
        cloud.feed,
        cloud.contacts,
        selection=FrameSelection(nodes or None),
        position=position,
        backlog=live.backlog,
        heartbeat=live.heartbeat_s,
        reader=EntryReader(cloud.key_access, scopes, cloud.feed.layouts, cloud.store),
        sealed=AccessScope.BIOMETRIC in scopes,
    )
    await websocket.accept()
    tasks = [
        asyncio.create_task(_send(websocket, frames)),
        asyncio.create_task(_receive(websocket, frames)),
    ]
    try:
        done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
    await _close(websocket, done.pop().result())


async def _send(websocket: WebSocket, frames: FrameStream) -> tuple[int, str] | None:
    """Send what comes; gives code and reason with which the WebSocket is closed."""
    try:
        async with contextlib.aclosing(frames.messages()) as messages:
            async for message in messages:
                await websocket.send_bytes(message)
    except WebSocketDisconnect:
        return None
    except StoreError as error:
        return _FAILED, str(error)
    except EskinError as error:  # the token was revoked, or a person erased
        return _REFUSED, str(error)
    return _RESTARTING, "the server stops; connect again"


async def _receive(websocket: WebSocket, frames: FrameStream) -> tuple[int, str] | None:
    """Take what the client asks for; gives code and reason as `_send`."""
    while True:
        try:
            message = SelectionMessage.model_validate_json(await websocket.receive_text())
        except WebSocketDisconnect:
            return None
        except KeyError:
            return _UNSUPPORTED, "send text, not binary data"
        except ValidationError as error:
            fault = error.errors(include_url=False, include_input=False)[0]
            place = ".".join(map(str, fault["loc"])) or "message"
            return _INVALID, f"{place}: {unprefixed(fault['msg'])}"
        frames.selection = message.selection


async def _close(websocket: WebSocket, closing: tuple[int, str] | None) -> None:
    if closing is not None:
        code, reason = closing
        text = reason[:_LONGEST_REASON].encode("ascii", "replace").decode()
        with contextlib.suppress(WebSocketDisconnect, RuntimeError):  # it is closed already
            await websocket.close(code, text)


def _require_room(cloud: AppState) -> None:
    open_ones = cloud.feed.subscribers
    if open_ones >= cloud.settings.live.subscribers:
        raise ProblemError(503, f"{open_ones} streams are open already; try again later")


def _require_known(cloud: AppState, nodes: Collection[str]) -> None:
    if nodes:
        with cloud.store.read() as connection:
            for node in sorted(nodes):
                find_node(connection, node)


async def resume(cloud: AppState, text: str | None, parameter: str) -> FeedPosition:
    """The position in the feed from which a client goes on.

    Args:
        cloud: The cloud.
        text: The last id or cursor that the client received, from any cloud on the store; without
            one it begins at the present.
        parameter: Its name.

    Raises:
        UnknownCursorError: No cloud on this store has issued it.
        StoreError: The store cannot be read.
    """
    feed = cloud.feed
    if text is None or not text:
        return feed.last
    try:
        position = feed.ids.read_position(text)
    except UnknownCursorError as error:
        raise UnknownCursorError(
            parameter, "leave it out, and read what was stored before from /events and /series"
        ) from error
    if not feed.last.reaches(position):  # another cloud sent what this one has not heard of yet
        await feed.catch_up()
    return position.no_later_than(feed.last)
