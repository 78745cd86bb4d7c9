"""The store of the cloud."""

from __future__ import annotations

import time
from contextlib import contextmanager
from typing import TYPE_CHECKING, Self, TypeVar

from sqlalchemy import update
from sqlalchemy.exc import SQLAlchemyError

from cloud.store.engine import reading_engine, writing_engine
from cloud.store.ledger import Ledger
from cloud.store.migrations import CURRENT, migrate, schema_version
from cloud.store.schema import feed
from cloud.store.writer import Writer
from eskin.errors import StoreError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from concurrent.futures import Future
    from pathlib import Path
    from types import TracebackType

    from sqlalchemy import Connection

T = TypeVar("T")


class Store:
    """Keeps blocks, events and who may read them, in one SQLite file.

    Attributes:
        path: The file.
        clock: Gives UTC ns.
        ledger: What the writer remembers of what is stored.
        writer: The thread that writes.
    """

    def __init__(
        self,
        path: Path,
        *,
        readers: int = 4,
        queue: int = 64,
        clock: Callable[[], int] = time.time_ns,
    ) -> None:
        """Open the store; make it where there is none.

        Raises:
            StoreError: It cannot be opened, or is of a later version.
        """
        self.path = path
        self.clock = clock
        self.ledger = Ledger()
        self._writing = writing_engine(path)
        self._reading = reading_engine(path, readers=readers)
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            with self._writing.begin() as connection:
                migrate(connection, now=clock())
        except (OSError, SQLAlchemyError) as error:
            self._dispose()
            cause = getattr(error, "orig", None) or error
            raise StoreError(f"{path}: the store cannot be opened: {cause}") from error
        except StoreError:
            self._dispose()
            raise
        self.writer = Writer(
            self._writing, capacity=queue, on_rollback=self.ledger.forget, probe=_touch
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def write(self, work: Callable[[Connection], T]) -> Future[T]:
        """Have work done within a transaction; the future is done once it is durable.

        Raises:
            StoreError: Too many writes wait, or the store is closed.
        """
        return self.writer.submit(work)

    @contextmanager
    def read(self) -> Iterator[Connection]:
        """A transaction that sees one state of the store.

        Raises:
            StoreError: The store cannot be read.
        """
        try:
            with self._reading.begin() as connection:
                yield connection
        except SQLAlchemyError as error:
            cause = getattr(error, "orig", None) or error
            raise StoreError(f"{self.path}: the store cannot be read: {cause}") from error

    def check(self) -> None:
        """Check that the store can be read, has the right schema and, after a fault, be written.

        Raises:
            StoreError: It is not ready.
        """
        with self.read() as connection:
            version = schema_version(connection)
        if version != CURRENT:
            raise StoreError(f"{self.path}: schema version is {version}, expected {CURRENT}")
        if self.writer.fault is not None:
            self.write(lambda _: None).result(timeout=30)

    def close(self) -> None:
        """Write what waits, then close the file."""
        self.writer.close()
        self._dispose()

    def _dispose(self) -> None:
        self._writing.dispose()
        self._reading.dispose()


def _touch(connection: Connection) -> None:
    connection.execute(update(feed).values(cursor=feed.c.cursor))
