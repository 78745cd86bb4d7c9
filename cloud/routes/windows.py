"""What questions about channels have in common: when, where a channel is read, and page by page."""

from __future__ import annotations

from contextlib import contextmanager
from itertools import islice
from typing import TYPE_CHECKING

from pydantic import BaseModel, ConfigDict, Field

from cloud.privacy.memory import unveiled
from cloud.query.cursors import read_numbers, write_cursor
from cloud.query.window import Window, make_window, read_window
from cloud.routes.documents import TIME, Time
from eskin.privacy import is_biometric

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sqlalchemy import Connection, RowMapping

    from cloud.dependencies import Access
    from cloud.query.runs import Run
    from cloud.state import Cloud


class WindowQuery(BaseModel):
    """When; without both, the last minute of data."""

    model_config = ConfigDict(extra="forbid")

    start: Time | None = Field(default=None, description=f"included; {TIME}")
    end: Time | None = Field(default=None, description=f"excluded; {TIME}")


@contextmanager
def opened(
    cloud: Cloud, access: Access, connection: Connection, row: RowMapping, window: Window
) -> Iterator[tuple[Connection, RowMapping]]:
    """Where a channel is read, and its row there: what tells of a person is opened in memory."""
    if not is_biometric(row["channel"]):
        yield connection, row
        return
    reader = cloud.keyholder.reader(access.holder.scopes, connection, access.opened)
    with unveiled(connection, reader, row, window) as source:
        yield source


def window_of(cloud: Cloud, row: RowMapping, query: WindowQuery) -> Window:
    """The window of a question about a channel."""
    last = row["t_last"]
    return read_window(query.start, query.end, last=cloud.clock() if last is None else last)


def resumed(cursor: str) -> Window:
    """The window that is left, by what `next` said."""
    start, end = read_numbers(cursor, 2)
    return make_window(start, end)


def paged(
    runs: Iterator[Run], window: Window, limit: int, *more: int
) -> tuple[list[Run], str | None]:
    """The first runs, and a cursor for what is left, which holds some numbers more.

    A page ends only where the next run begins later than all before it have ended.
    """
    found = list(islice(runs, limit))
    for run in runs:
        if run.start > found[-1].end:
            return found, write_cursor(run.start, window.end, *more)
        found.append(run)
    return found, None
