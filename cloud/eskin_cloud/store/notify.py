"""Notify the other processes on a PostgreSQL store (NOTIFY), after the commit.

Within the transaction it would make all commits of the server wait for each other: PostgreSQL holds
one lock from NOTIFY to the end of the commit. Notifications may be lost: readers also poll.
"""

from __future__ import annotations

import logging
import threading
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final

import psycopg

if TYPE_CHECKING:
    from collections.abc import Mapping

    from sqlalchemy import Connection

log = logging.getLogger(__name__)

CHANNEL: Final = "eskin"
FEED: Final = "feed"
"""Messages were stored; arguments: the process's name, the last cursor of each slot."""
COMMANDS: Final = "commands"
"""A command was issued or answered, or an alarm has changed."""
_SEND: Final = b"SELECT pg_notify(%s, %s)"
_RETRY_S: Final = 1.0
_PAUSE_S: Final = 0.02
_KEY: Final = "news"


@dataclass(slots=True)
class News:
    """What a transaction changed that other processes wait for.

    Attributes:
        cursors: The last cursor of each slot in which messages were stored.
        commands: Whether a command or an alarm has changed.
    """

    cursors: dict[int, int] = field(default_factory=dict)
    commands: bool = False

    def __bool__(self) -> bool:
        return self.commands or bool(self.cursors)

    def add(self, later: News) -> None:
        """Add what a later transaction changed."""
        self.cursors |= later.cursors
        self.commands = self.commands or later.commands


def announce(connection: Connection, news: News) -> None:
    """Have other processes notified once the transaction is durable."""
    if news:
        connection.info.setdefault(_KEY, News()).add(news)


def take_news(connection: Connection) -> News:
    """What was announced since the last call."""
    news: News = connection.info.pop(_KEY, None) or News()
    return news


class NoticeSender:
    """Sends notifications in a thread; what is added while one is sent is sent together.

    Args:
        arguments: Of libpq, for the connection.
        name: Identifies this process to others.
    """

    def __init__(self, arguments: Mapping[str, Any], *, name: str) -> None:
        self._arguments = arguments
        self._name = name
        self._news = News()
        self._changed = threading.Condition()
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._run, name="notices", daemon=True)
        self._thread.start()

    def add(self, news: News) -> None:
        """Have other processes notified."""
        if news:
            with self._changed:
                self._news.add(news)
                self._changed.notify()

    def close(self) -> None:
        """Send what was added, then stop."""
        with self._changed:
            self._closing.set()
            self._changed.notify()
        self._thread.join()

    def _run(self) -> None:
        connection: psycopg.Connection | None = None
        while (news := self._next()) is not None:
            try:
                if connection is None:
                    connection = psycopg.connect(autocommit=True, **self._arguments)
                    # A notification needs no flush; what it names is durable.
                    connection.execute(b"SET synchronous_commit = off")
                for text in self._texts(news):
                    connection.execute(_SEND, (CHANNEL, text))
            except psycopg.Error as error:
                log.warning("notification lost: reason=%s", error)
                if connection is not None:
                    connection.close()
                    connection = None
                self._closing.wait(_RETRY_S)
            else:
                # Each notification wakes all other processes: under load, some commits share one.
                self._closing.wait(_PAUSE_S)
        if connection is not None:
            connection.close()

    def _next(self) -> News | None:
        """What was added; ``None`` at the end."""
        with self._changed:
            self._changed.wait_for(lambda: self._news or self._closing.is_set())
            news, self._news = self._news, News()
        return news or None

    def _texts(self, news: News) -> list[str]:
        texts = [COMMANDS] if news.commands else []
        if news.cursors:
            texts.append(" ".join([FEED, self._name, *map(str, news.cursors.values())]))
        return texts
