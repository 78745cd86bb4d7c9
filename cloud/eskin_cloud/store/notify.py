"""Notify the other processes on a PostgreSQL store, by NOTIFY within the transaction.

The server delivers a notification after the commit. An SQLite store has one process only.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from sqlalchemy import func, select

if TYPE_CHECKING:
    from sqlalchemy import Connection

CHANNEL: Final = "eskin"
FEED: Final = "feed"
"""Messages were stored; arguments: the writer's name, the last cursor of each slot."""
COMMANDS: Final = "commands"
"""A command was issued or answered."""


def notify(connection: Connection, kind: str, *arguments: object) -> None:
    """Notify the other processes, once this transaction is durable."""
    if connection.dialect.name == "postgresql":
        text = " ".join([kind, *map(str, arguments)])
        connection.execute(select(func.pg_notify(CHANNEL, text)))
