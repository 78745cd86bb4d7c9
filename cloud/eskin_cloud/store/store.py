"""The store of the cloud."""

from __future__ import annotations

import time
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Final, Self, TypeVar

from sqlalchemy import update
from sqlalchemy.exc import SQLAlchemyError

from eskin.errors import StoreError
from eskin.runtime.sqlite_integrity import UNREADABLE
from eskin_cloud.store.damage import damaged_rows
from eskin_cloud.store.db_errors import explain
from eskin_cloud.store.integrity import check_small_tables
from eskin_cloud.store.location import StoreLocation, describe, reading_engine, writing_engine
from eskin_cloud.store.pg_copy import finish_copy
from eskin_cloud.store.schema.tables import feed
from eskin_cloud.store.slot import SLOTS
from eskin_cloud.store.version import create_tables, require_version
from eskin_cloud.store.write.write_cache import WriteCache
from eskin_cloud.store.write.writer import Writer

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from concurrent.futures import Future
    from types import TracebackType

    from sqlalchemy import Connection

T = TypeVar("T")

_WRITE_TIMEOUT_S: Final = 30.0


class Store:
    """Stores messages, tokens and settings in an SQLite file or a PostgreSQL database.

    Attributes:
        location: The file, or the server's URL.
        clock: Returns UTC ns.
        readers: Number of connections that read.
        compacted: Bytes of frames that were compacted since the start.
        cache: The writer's cache of stored rows.
        writer: The thread that writes.
        damage: Why the store is not read any more (`jobs.integrity`); ``None`` if it is intact.
    """

    def __init__(
        self,
        location: StoreLocation,
        *,
        readers: int = 4,
        queue: int = 64,
        clock: Callable[[], int] = time.time_ns,
    ) -> None:
        """Open the store, or create it.

        Raises:
            StoreError: The store cannot be opened, or has another version.
        """
        self.location = location
        self.clock = clock
        self.readers = readers
        self.compacted = 0
        self.cache = WriteCache()
        self.damage: str | None = None
        damaged_rows.clear()
        self._writing = writing_engine(location)
        self._reading = reading_engine(location, readers=readers)
        try:
            if isinstance(location, Path):
                location.parent.mkdir(parents=True, exist_ok=True)
            with self._writing.begin() as connection:
                create_tables(connection, now=clock())
                check_small_tables(connection)
        except (OSError, SQLAlchemyError, StoreError, *UNREADABLE) as error:
            self._dispose()
            raise StoreError(f"{self}: the store cannot be opened: {explain(error)}") from error
        self.writer = Writer(
            self._writing,
            capacity=queue,
            on_begin=self._begin,
            on_save=self._save,
            on_rollback=self.cache.clear,
            probe=_probe,
        )

    def __str__(self) -> str:
        return describe(self.location)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def write(
        self,
        work: Callable[[Connection], T],
        *,
        fallback: Callable[[Connection], T] | None = None,
        shared: bool = False,
    ) -> Future[T]:
        """Queue work for a transaction; the future is done once it is durable.

        Args:
            work: Runs in the transaction; its changes of the cache are saved.
            fallback: Runs instead if ``work`` raises anything but an `EskinError`.
            shared: Whether ``work`` reads by SQL nothing that other shared work changes through
                the cache. See `Writer.submit`.

        Raises:
            StoreError: Too many writes wait, or the store is closed.
        """
        return self.writer.submit(work, fallback=fallback, shared=shared)

    def write_and_wait(self, work: Callable[[Connection], T]) -> T:
        """Run work in a transaction, and wait until it is durable.

        Raises:
            StoreError: The commit takes too long, too many writes wait, or the write fails.
        """
        written = self.write(work)
        try:
            return written.result(_WRITE_TIMEOUT_S)
        except TimeoutError as error:
            written.cancel()
            raise StoreError(
                f"{self}: nothing was written for {_WRITE_TIMEOUT_S:g} s; "
                "check what else uses the store, then retry"
            ) from error

    @contextmanager
    def read(self) -> Iterator[Connection]:
        """A read transaction on one state of the store.

        Raises:
            StoreError: The store cannot be read, is damaged, or has another version.
        """
        if self.damage is not None:
            raise StoreError(self.damage)
        try:
            with self._reading.begin() as connection:
                require_version(connection)
                yield connection
        except (SQLAlchemyError, UnicodeDecodeError) as error:
            raise StoreError(f"{self}: the store cannot be read: {explain(error)}") from error

    def check(self) -> None:
        """Check that the store can be read and, after a fault, written.

        Raises:
            StoreError: It is not ready.
        """
        with self.read():
            pass
        if self.writer.fault is not None:
            self.write_and_wait(lambda _: None)

    def shrink(self) -> None:
        """Free the page caches of SQLite's connections, up to 32 MiB each.

        Raises:
            StoreError: The store cannot be used.
        """
        if not isinstance(self.location, Path):
            return
        self.write_and_wait(_shrink)
        for _ in range(self.readers):  # the pool returns the one that was idle longest
            with self.read() as connection:
                _shrink(connection)

    def close(self) -> None:
        """Run queued writes, then close the store."""
        self.writer.close()
        self._dispose()

    def _begin(self, connection: Connection) -> None:
        """Check the version and refresh the cache: other processes may have written."""
        require_version(connection)
        self.cache.lock(connection, range(SLOTS))

    def _save(self, connection: Connection) -> None:
        """Write the cache's changes, and finish a COPY."""
        self.cache.save(connection)
        finish_copy(connection)

    def _dispose(self) -> None:
        self._writing.dispose()
        self._reading.dispose()


def _shrink(connection: Connection) -> None:
    connection.exec_driver_sql("PRAGMA shrink_memory")


def _probe(connection: Connection) -> None:
    connection.execute(update(feed).values(cursor=feed.c.cursor))
