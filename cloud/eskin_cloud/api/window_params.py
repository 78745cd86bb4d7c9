"""What questions about channels have in common: when, where a channel is read, and page by page."""

from __future__ import annotations

from contextlib import contextmanager
from itertools import islice
from typing import TYPE_CHECKING

from pydantic import BaseModel, ConfigDict, Field

from eskin.privacy import is_biometric
from eskin_cloud.privacy.decrypted_window import decrypted_window
from eskin_cloud.query.cursors import read_numbers, write_cursor
from eskin_cloud.schemas.base import TIME, Time
from eskin_cloud.store.read.window import Window, make_window, parse_window

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sqlalchemy import Connection

    from eskin_cloud.api.dependencies import Access
    from eskin_cloud.app_state import AppState
    from eskin_cloud.query.segments import Segment
    from eskin_cloud.store.read.lookup import Channel


class WindowQuery(BaseModel):
    """When; without both, the last minute of data."""

    model_config = ConfigDict(extra="forbid")

    start: Time | None = Field(default=None, description=f"included; {TIME}")
    end: Time | None = Field(default=None, description=f"excluded; {TIME}")


@contextmanager
def opened(
    cloud: AppState, access: Access, connection: Connection, row: Channel, window: Window
) -> Iterator[tuple[Connection, Channel]]:
    """Where a channel is read, and its row there: a biometric one is decrypted in memory."""
    if not is_biometric(row["channel"]):
        yield connection, row
        return
    reader = cloud.key_access.reader(access.holder.scopes, connection, access.opened)
    with decrypted_window(connection, reader, row, window) as source:
        yield source


def window_of(cloud: AppState, row: Channel, query: WindowQuery) -> Window:
    """The window of a question about a channel."""
    last = row["t_last"]
    return parse_window(query.start, query.end, last=cloud.clock() if last is None else last)


def resumed(cursor: str) -> Window:
    """The window that is left, by what `next` said."""
    start, end = read_numbers(cursor, 2)
    return make_window(start, end)


def paged(
    runs: Iterator[Segment], window: Window, limit: int, *more: int
) -> tuple[list[Segment], str | None]:
    """The first runs, and a cursor for what is left, which holds some numbers more.

    A page ends only where the next run begins later than all before it have ended.
    """
    found = list(islice(runs, limit))
    for run in runs:
        if run.start > found[-1].end:
            return found, write_cursor(run.start, window.end, *more)
        found.append(run)
    return found, None
