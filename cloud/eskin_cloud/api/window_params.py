"""What questions about channels have in common: when, where a channel is read, and page by page."""

from __future__ import annotations

from contextlib import contextmanager
from typing import TYPE_CHECKING

from pydantic import BaseModel, ConfigDict, Field

from eskin.privacy import is_biometric
from eskin_cloud.privacy.decrypted_window import decrypted_window
from eskin_cloud.schemas.base import TIME, Time
from eskin_cloud.store.read.window import Window, parse_window

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sqlalchemy import Connection

    from eskin_cloud.api.dependencies import Access
    from eskin_cloud.app_state import AppState
    from eskin_cloud.store.read.lookup import Channel


class WindowQuery(BaseModel):
    """When; without both, the last minute of data."""

    model_config = ConfigDict(extra="forbid")

    start: Time | None = Field(default=None, description=f"included; {TIME}")
    end: Time | None = Field(default=None, description=f"excluded; {TIME}")


class PagedWindowQuery(WindowQuery):
    """When, and which page of the stretches."""

    limit: int = Field(default=1000, ge=1, le=10_000, description="stretches at once")
    cursor: str | None = Field(default=None, max_length=1000, description="the value of `next`")


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
