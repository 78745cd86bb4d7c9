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
from eskin_cloud.store.db_errors import explain
from eskin_cloud.store.integrity import require_whole
from eskin_cloud.store.location import Place, reading_engine, show, writing_engine
from eskin_cloud.store.pg_copy import finish
from eskin_cloud.store.schema.tables import feed
from eskin_cloud.store.version import prepare, require_current
from eskin_cloud.store.write.write_cache import WriteCache
from eskin_cloud.store.write.writer import Writer

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from concurrent.futures import Future
    from types import TracebackType

    from sqlalchemy import Connection

T = TypeVar("T")

_PATIENCE_S: Final = 30.0


class Store:
    """Keeps blocks, events and who may read them, in an SQLite file or on a PostgreSQL server.

    Attributes:
        place: The file, or the server's URL.
        clock: Gives UTC ns.
        readers: Most connections that read.
        packed: Bytes of the blocks that were packed, since the start.
        cache: What the writer remembers of what is stored.
        writer: The thread that writes.
    """

    def __init__(
        self,
        place: Place,
        *,
        readers: int = 4,
        queue: int = 64,
        clock: Callable[[], int] = time.time_ns,
    ) -> None:
        """Open the store; make it where there is none.

        Raises:
            StoreError: It cannot be opened, or is of another version.
        """
        self.place = place
        self.clock = clock
        self.readers = readers
        self.packed = 0
        self.cache = WriteCache()
        self._writing = writing_engine(place)
        self._reading = reading_engine(place, readers=readers)
        try:
            if isinstance(place, Path):
                place.parent.mkdir(parents=True, exist_ok=True)
            with self._writing.begin() as connection:
                prepare(connection, now=clock())
                require_whole(connection)
        except (OSError, SQLAlchemyError, StoreError, *UNREADABLE) as error:
            self._dispose()
            raise StoreError(f"{self}: the store cannot be opened: {explain(error)}") from error
        self.writer = Writer(
            self._writing,
            capacity=queue,
            on_begin=self._begin,
            on_save=self._save,
            on_rollback=self.cache.forget,
            probe=_touch,
        )

    def __str__(self) -> str:
        return show(self.place)

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
        instead: Callable[[Connection], T] | None = None,
        together: bool = False,
    ) -> Future[T]:
        """Have work done within a transaction; the future is done once it is durable.

        Args:
            work: What is done; what the cache learns by it is saved.
            instead: Done where that broke by an error that is none of ours.
            together: Whether it reads nothing by SQL that work like it changes through the
                cache; then that is saved once for all. See `Writer.submit`.

        Raises:
            StoreError: Too many writes wait, or the store is closed.
        """
        return self.writer.submit(work, instead=instead, together=together)

    def finish(self, work: Callable[[Connection], T]) -> T:
        """Have work done within a transaction, and wait until it is durable.

        Raises:
            StoreError: It is not in time, too many writes wait, or the store cannot be written.
        """
        written = self.write(work)
        try:
            return written.result(_PATIENCE_S)
        except TimeoutError as error:
            written.cancel()
            raise StoreError(
                f"{self}: nothing was written for {_PATIENCE_S:g} s; see what else the store does, "
                "then try again"
            ) from error

    @contextmanager
    def read(self) -> Iterator[Connection]:
        """A transaction that sees one state of the store, of the schema that this program knows.

        Raises:
            StoreError: The store cannot be read, or is of another version.
        """
        try:
            with self._reading.begin() as connection:
                require_current(connection)
                yield connection
        except (SQLAlchemyError, UnicodeDecodeError) as error:
            raise StoreError(f"{self}: the store cannot be read: {explain(error)}") from error

    def check(self) -> None:
        """Check that the store can be read, has the right schema and, after a fault, be written.

        Raises:
            StoreError: It is not ready.
        """
        with self.read():
            pass
        if self.writer.fault is not None:
            self.finish(lambda _: None)

    def shrink(self) -> None:
        """Give up what SQLite's connections keep of the file in memory, up to 32 MiB each.

        Raises:
            StoreError: The store cannot be used.
        """
        if not isinstance(self.place, Path):
            return
        self.finish(_shrink)
        for _ in range(self.readers):  # the pool gives the one that rested longest
            with self.read() as connection:
                _shrink(connection)

    def close(self) -> None:
        """Write what waits, then close the file."""
        self.writer.close()
        self._dispose()

    def _begin(self, connection: Connection) -> None:
        """Another program may have replaced the store, and another process may have written."""
        require_current(connection)
        self.cache.refresh(connection)

    def _save(self, connection: Connection) -> None:
        """Write what is only remembered, and rows that are under way."""
        self.cache.save(connection)
        finish(connection)

    def _dispose(self) -> None:
        self._writing.dispose()
        self._reading.dispose()


def _shrink(connection: Connection) -> None:
    connection.exec_driver_sql("PRAGMA shrink_memory")


def _touch(connection: Connection) -> None:
    connection.execute(update(feed).values(cursor=feed.c.cursor))
