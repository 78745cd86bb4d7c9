"""The writer of a group of slots, or of central rows, with its cache."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Final, TypeVar

from sqlalchemy import exists, select, update

from eskin_cloud.store.notify import News, take_news
from eskin_cloud.store.pg_copy import finish_copy
from eskin_cloud.store.schema.tables import feed, versions
from eskin_cloud.store.version import require_version
from eskin_cloud.store.write.write_cache import MOVING, WriteCache, refuse_moving
from eskin_cloud.store.write.writer import Writer

if TYPE_CHECKING:
    from collections.abc import Callable, Collection
    from collections.abc import Set as AbstractSet
    from concurrent.futures import Future

    from sqlalchemy import Connection, Engine

    from eskin_cloud.store.notify import NoticeSender

T = TypeVar("T")

_IS_MOVING: Final = select(exists().where(feed.c.slot == 0, feed.c.writer == MOVING))
"""A move marks all slots at once; that of one is read from one shard, not from all."""


class SlotWriter:
    """A thread that writes, with what it has cached of the slots that it writes.

    Args:
        engine: With one connection.
        notices: Notifies other processes after a commit; ``None`` where there are none.
        name: Identifies the process to them.
        cursor_key: The store's (`require_version`).
        queue: Most jobs that may wait.
        on_fault: Called in its thread after the store failed.
        threaded: Whether a thread writes, as of `Writer`.

    Attributes:
        cache: The cache; used in its thread only.
        writer: Runs the jobs.
    """

    def __init__(
        self,
        engine: Engine,
        notices: NoticeSender | None,
        *,
        name: str,
        cursor_key: bytes,
        queue: int,
        on_fault: Callable[[], None],
        threaded: bool = True,
    ) -> None:
        self.cache = WriteCache(name)
        self._notices = notices
        self._cursor_key = cursor_key
        self._news = News()
        self.writer = Writer(
            engine,
            capacity=queue,
            on_begin=self._begin,
            on_save=self._save,
            on_commit=self._commit,
            on_rollback=self.cache.clear,
            on_fault=on_fault,
            probe=_probe,
            threaded=threaded,
        )

    def submit(
        self,
        slots: Collection[int],
        work: Callable[[Connection, WriteCache], T],
        *,
        group: int,
        fallback: Callable[[Connection, WriteCache], T] | None,
        shared: bool,
    ) -> Future[T]:
        """Queue work on rows of nodes. Arguments are those of `Store.write_slots`, and the group.

        Raises:
            StoreError: Too many jobs wait, or the store is closed.
        """
        bound = [partial(_call, each, self.cache) for each in (work, fallback) if each is not None]
        return self.writer.submit(
            bound[0],
            fallback=bound[1] if fallback else None,
            shared=shared,
            slots=slots,
            group=group,
        )

    def _begin(self, connection: Connection, slots: AbstractSet[int]) -> None:
        """Check version and store, and lock the slots: other processes may have written."""
        take_news(connection)  # of a transaction that was rolled back
        self._news = News()
        require_version(connection, self._cursor_key)
        if slots:
            self.cache.lock(connection, slots)
        elif connection.execute(_IS_MOVING).scalar_one():
            refuse_moving()

    def _save(self, connection: Connection) -> None:
        """Write the cache's changes, and finish a COPY."""
        self.cache.save(connection)
        finish_copy(connection)
        self._news.add(take_news(connection))

    def _commit(self) -> None:
        if self._notices is not None:
            self._notices.add(self._news)


def _call(
    work: Callable[[Connection, WriteCache], T], cache: WriteCache, connection: Connection
) -> T:
    return work(connection, cache)


def _probe(connection: Connection, slots: AbstractSet[int]) -> None:
    if slots:
        here = feed.c.slot.in_(slots)
        connection.execute(update(feed).where(here).values(cursor=feed.c.cursor))
    else:
        connection.execute(update(versions).values(applied=versions.c.applied))
