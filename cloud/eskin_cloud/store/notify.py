"""What one process tells the others that share its store: by NOTIFY, within the transaction.

A server hands it on after the commit only. An SQLite file has one process: there is nobody to tell.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from sqlalchemy import func, select

if TYPE_CHECKING:
    from sqlalchemy import Connection

CHANNEL: Final = "eskin"
FEED: Final = "feed"
"""Something was stored; its last cursor follows, and who stored it."""
COMMANDS: Final = "commands"
"""A command was issued or answered."""
WATCHED: Final = "watched"
"""Somebody looks at nodes, whose names follow."""


def notify(connection: Connection, kind: str, *words: object) -> None:
    """Tell the others, once this transaction is durable."""
    if connection.dialect.name == "postgresql":
        text = " ".join([kind, *map(str, words)])
        connection.execute(select(func.pg_notify(CHANNEL, text)))
