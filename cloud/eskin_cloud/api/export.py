"""All samples of channels in a window, streamed as a file."""

from collections.abc import Iterator
from contextlib import ExitStack, nullcontext
from typing import Annotated, Final
from urllib.parse import urlencode

from fastapi import APIRouter, Header, Query, Request
from pydantic import BaseModel, ConfigDict, Field
from sqlalchemy import Connection
from starlette.responses import Response, StreamingResponse

from eskin.errors import QueryError
from eskin.privacy import is_biometric
from eskin.runtime.http_server.problems import ProblemError, documented
from eskin_cloud.api.dependencies import Access, CloudState, Reader
from eskin_cloud.api.export_formats import WRITERS, write
from eskin_cloud.api.problems import REFUSALS_OF_PLACE
from eskin_cloud.api.responses import choose
from eskin_cloud.app_state import AppState
from eskin_cloud.privacy.decrypted_window import decrypted_window
from eskin_cloud.query.export import Export, ExportChannel, ExportPosition
from eskin_cloud.schemas.base import TIME, Place, Time
from eskin_cloud.store.read.lookup import Channel, find_channel, parse_channel
from eskin_cloud.store.read.window import Window, make_window, parse_time

router = APIRouter(tags=["series"])

_SUFFIXES: Final = {
    "text/csv": "csv",
    "application/vnd.apache.arrow.stream": "arrows",
    "application/vnd.apache.parquet": "parquet",
}


class ExportQuery(BaseModel):
    """What to export."""

    model_config = ConfigDict(extra="forbid")

    channel: list[Place] = Field(
        min_length=1, max_length=1000, description="NODE/CHANNEL; may be repeated"
    )
    start: Time | None = Field(default=None, description=f"included; {TIME}; else the first sample")
    end: Time | None = Field(
        default=None, description=f"excluded; {TIME}; else behind the last sample"
    )
    limit: int | None = Field(
        default=None,
        ge=1,
        le=10**9,
        description="samples after which the file ends, with its frame; `Link` states how to go on",
    )
    cursor: str | None = Field(default=None, max_length=1000, description="from `Link`")


@router.get(
    "/export",
    response_class=StreamingResponse,
    responses={
        200: {"content": {media: {} for media in WRITERS}, "description": "a file"},
        **REFUSALS_OF_PLACE,
        **documented(406),
    },
)
def get_export(
    cloud: CloudState,
    access: Reader,
    request: Request,
    query: Annotated[ExportQuery, Query()],
    accept: Annotated[str | None, Header(include_in_schema=False)] = None,
) -> Response:
    """Export all samples of channels as CSV, Arrow or Parquet."""
    media = choose(accept, tuple(WRITERS))
    if media is None:
        raise ProblemError(406, f"{accept!r} is not offered; accept one of {', '.join(WRITERS)}")
    with ExitStack() as stack:
        export = _open(cloud, access, query, stack)
        until = None if query.limit is None else export.find_end(query.limit)
        headers = {
            "Vary": "Accept",
            "Content-Disposition": f'attachment; filename="eskin.{_SUFFIXES[media]}"',
        }
        if query.cursor is None:
            headers["Eskin-Samples"] = str(export.samples())
        if until is not None:
            headers["Link"] = (
                f'<{_following(cloud, request, query, export.window, until)}>; rel="next"'
            )
        opened = stack.pop_all()
    return StreamingResponse(
        stream_file(export, until, media, access, opened), media_type=media, headers=headers
    )


def stream_file(
    export: Export, until: ExportPosition | None, media: str, access: Access, opened: ExitStack
) -> Iterator[bytes]:
    """The file's pieces, for as long as the reader may read."""
    with opened:
        for piece in write(media, export.read(until), export.window):
            access.require()
            yield piece


def _open(cloud: AppState, access: Access, query: ExportQuery, stack: ExitStack) -> Export:
    places = [parse_channel(text) for text in query.channel]
    with cloud.store.read() as connection:
        rows = [find_channel(connection, *place) for place in places]
        window, after = (
            _whole(rows, query) if query.cursor is None else _resume(cloud, query, len(rows))
        )
        sources = [_source(cloud, access, connection, row, window, stack) for row in rows]
    return Export(sources, window, after)


def _source(
    cloud: AppState,
    access: Access,
    connection: Connection,
    row: Channel,
    window: Window,
    stack: ExitStack,
) -> ExportChannel:
    """Where a channel is read: a biometric one is decrypted in memory for the export."""
    if not is_biometric(row["channel"]):
        node = row["node"]
        if not access.uncounted(connection, [node]):
            return ExportChannel(row, cloud.store.read)
        ids = cloud.feed.ids
        return ExportChannel(
            row, cloud.store.read, lambda run: ids.number(node, run.boot, run.sequence)
        )
    reader = cloud.key_access.reader(access.holder.scopes, connection, access.opened)
    memory, known = stack.enter_context(decrypted_window(connection, reader, row, window))
    return ExportChannel(known, lambda: nullcontext(memory))


def _whole(rows: list[Channel], query: ExportQuery) -> tuple[Window, None]:
    """The window that is asked for; where it is open, it takes in all that there is."""
    start, end = parse_time("start", query.start), parse_time("end", query.end)
    first = min((row["t_first"] for row in rows if row["t_first"] is not None), default=0)
    last = max((row["t_last"] for row in rows if row["t_last"] is not None), default=-1)
    begin = first if start is None else start
    return make_window(begin, max(begin, last + 1) if end is None else end), None


def _resume(cloud: AppState, query: ExportQuery, channels: int) -> tuple[Window, ExportPosition]:
    """A cursor holds the window, too: new data must not move an open one."""
    start, end, *place = cloud.feed.ids.read(query.cursor or "", 6)
    after = ExportPosition(*place)
    if not 0 <= after.channel < channels:
        raise QueryError("cursor", "belongs to other channels; name the same, in the same order")
    return make_window(start, end), after


def _following(
    cloud: AppState, request: Request, query: ExportQuery, window: Window, until: ExportPosition
) -> str:
    cursor = cloud.feed.ids.write(window.start, window.end, *until)
    known = [("channel", each) for each in query.channel]
    return f"{request.scope['path']}?" + urlencode(
        [*known, ("limit", query.limit or 0), ("cursor", cursor)]
    )
