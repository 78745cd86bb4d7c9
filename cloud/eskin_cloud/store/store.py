"""The store of the cloud."""

from __future__ import annotations

import secrets
import time
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Final, Self, TypeVar

from sqlalchemy import select
from sqlalchemy.exc import SQLAlchemyError

from eskin.errors import StoreError
from eskin.runtime.sqlite_integrity import UNREADABLE
from eskin.wire.slot import SLOTS, SlotShare, even_groups, share_out, slot_of
from eskin_cloud.store.damage import damaged_rows
from eskin_cloud.store.db_errors import explain
from eskin_cloud.store.integrity import check_small_tables
from eskin_cloud.store.location import (
    StoreLocation,
    describe,
    reading_engine,
    slot_engines,
    writing_engine,
)
from eskin_cloud.store.notify import NoticeSender
from eskin_cloud.store.postgres import driver_arguments, living_clouds
from eskin_cloud.store.schema.tables import feed
from eskin_cloud.store.shard_groups import read_groups, shard_places, shard_places_now
from eskin_cloud.store.version import create_tables, require_version
from eskin_cloud.store.write.slot_writer import SlotWriter

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Iterator
    from concurrent.futures import Future
    from types import TracebackType

    from sqlalchemy import Connection

    from eskin_cloud.store.write.write_cache import WriteCache
    from eskin_cloud.store.write.writer import Writer

T = TypeVar("T")

_WRITE_TIMEOUT_S: Final = 30.0


class Store:
    """Stores messages, tokens and settings in an SQLite file or a PostgreSQL database.

    Attributes:
        location: The file, or the server's URL.
        clock: Returns UTC ns.
        readers: Number of connections that read.
        cursor_key: Encrypts cursors for clients (`eskin_cloud.query.opaque_ids`).
        compacted: Bytes of frames that were compacted since the start.
        name: Identifies this process to the others on the store.
        damage: Why the store is not read any more (`jobs.integrity`); ``None`` if it is intact.
    """

    def __init__(
        self,
        location: StoreLocation,
        *,
        readers: int = 4,
        queue: int = 64,
        clock: Callable[[], int] = time.time_ns,
        threaded: bool = True,
    ) -> None:
        """Open the store, or create it.

        Args:
            location: The file, or the server's URL.
            readers: Number of connections that read.
            queue: Most writes that may wait.
            clock: Returns UTC ns.
            threaded: Whether threads write. Without them, a write runs in its caller's thread, of
                which there must be only one.

        Raises:
            StoreError: The store cannot be opened, or has another version.
        """
        self.location = location
        self.clock = clock
        self.readers = readers
        self.compacted = 0
        self.name = secrets.token_hex(16)
        self.damage: str | None = None
        damaged_rows.clear()
        self._writing = writing_engine(location)
        self._of_slots = slot_engines(location)
        self._reading = reading_engine(location, readers=readers, name=self.name)
        try:
            if isinstance(location, Path):
                location.parent.mkdir(parents=True, exist_ok=True)
            with self._writing.begin() as connection:
                self.cursor_key = create_tables(connection, now=clock())
                check_small_tables(connection)
        except (OSError, SQLAlchemyError, StoreError, *UNREADABLE) as error:
            self._dispose()
            raise StoreError(f"{self}: the store cannot be opened: {explain(error)}") from error
        self._notices: NoticeSender | None = None
        if not isinstance(location, Path):
            self._notices = NoticeSender(driver_arguments(location), name=self.name)
        make_writer = partial(
            SlotWriter,
            notices=self._notices,
            name=self.name,
            cursor_key=self.cursor_key,
            queue=queue,
            on_fault=self._read_groups,
            threaded=threaded,
        )
        self._central = make_writer(self._writing)
        self._slot_writers = [make_writer(engine) for engine in self._of_slots] or [self._central]
        self._groups = even_groups(len(self._slot_writers))
        self._places: str | None = None
        self._read_groups()

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

    def write(self, work: Callable[[Connection], T], *, shared: bool = False) -> Future[T]:
        """Queue work on central rows for a transaction; the future is done once it is durable.

        Args:
            work: Runs in the transaction. It writes no rows of nodes.
            shared: Whether ``work`` needs no savepoint. See `Writer.submit`.

        Raises:
            StoreError: Too many writes wait, or the store is closed.
        """
        return self._central.writer.submit(work, shared=shared)

    def write_slots(
        self,
        slots: Collection[int],
        work: Callable[[Connection, WriteCache], T],
        *,
        fallback: Callable[[Connection, WriteCache], T] | None = None,
        shared: bool = False,
    ) -> Future[T]:
        """Queue work on rows of nodes for a transaction; the future is done once it is durable.

        The transaction locks the slots first. Writers of different slots do not wait for each
        other, nor for those of central rows.

        Args:
            slots: The slots of the nodes, of one group (`shares`).
            work: Runs in the transaction; its changes of the cache are saved. It writes no central
                rows.
            fallback: Runs instead if ``work`` raises anything but an `EskinError`.
            shared: Whether ``work`` reads by SQL nothing that other shared work changes through
                the cache. See `Writer.submit`.

        Raises:
            StoreError: Too many writes wait, or the store is closed.
        """
        groups = {self._groups[slot] for slot in slots}
        if len(groups) != 1:
            raise StoreError("a shard of the store was split meanwhile; retry")
        (group,) = groups
        writer = self._slot_writers[group % len(self._slot_writers)]
        return writer.submit(slots, work, group=group, fallback=fallback, shared=shared)

    def write_node(self, node: str, work: Callable[[Connection, WriteCache], T]) -> Future[T]:
        """Queue work on the rows of one node. See `write_slots`."""
        return self.write_slots([slot_of(node)], work)

    def shares(self, items: Iterable[T], node_of: Callable[[T], str]) -> list[SlotShare[T]]:
        """Share items out by the groups of their nodes' slots, which are written apart."""
        return share_out(items, node_of, self._groups)

    def _read_groups(self) -> None:
        """Read which slots are of one shard: after the start, and after a fault.

        A shard that was split has made a transaction span two, which the server refuses.
        """
        with suppress(StoreError), self.read() as connection:
            self._places = shard_places(connection)
            shards = read_groups(connection)
            if len(shards) > 1:
                numbers = {slot: group for group, slots in enumerate(shards) for slot in slots}
                self._groups = tuple(numbers[slot] for slot in range(SLOTS))

    def own_slots(self) -> set[int]:
        """The slots whose background work is this process's, as it wrote them last.

        A slot whose last writer has ended is of any process. Where two processes do the same work,
        one result is dropped.

        Raises:
            StoreError: The store cannot be read.
        """
        if isinstance(self.location, Path):
            return set(range(SLOTS))
        with self.read() as connection:
            others = living_clouds(connection) - {self.name}
            writers = connection.execute(select(feed.c.slot, feed.c.writer)).all()
        return {slot for slot, writer in writers if writer not in others}

    @property
    def waiting(self) -> int:
        """Number of waiting writes."""
        return sum(each.waiting for each in self._writers)

    @property
    def commits(self) -> int:
        """Number of commits."""
        return sum(each.commits for each in self._writers)

    @property
    def jobs(self) -> int:
        """Number of committed writes."""
        return sum(each.jobs for each in self._writers)

    @property
    def fault(self) -> str | None:
        """Why a last commit failed; ``None`` after a success of all writers."""
        return next((each.fault for each in self._writers if each.fault is not None), None)

    @property
    def _writers(self) -> list[Writer]:
        return list(dict.fromkeys(each.writer for each in [self._central, *self._slot_writers]))

    def write_and_wait(self, work: Callable[[Connection], T]) -> T:
        """Run work in a transaction, and wait until it is durable.

        Raises:
            StoreError: The commit takes too long, too many writes wait, or the write fails.
        """
        return _wait(self, self.write(work))

    def clear_caches(self) -> None:
        """Drop what the writers have cached, after their present transactions."""
        for each in self._slot_writers:
            _wait(self, each.writer.submit(partial(_clear, each.cache)))

    @contextmanager
    def read(self) -> Iterator[Connection]:
        """A read transaction on one state of the store.

        Raises:
            StoreError: The store cannot be read, is damaged, has another version, was replaced, or
                a shard of it was moved meanwhile: then nothing that was read counts.
        """
        if self.damage is not None:
            raise StoreError(self.damage)
        places = self._places
        try:
            try:
                with self._reading.begin() as connection:
                    require_version(connection, self.cursor_key)
                    yield connection
            finally:  # also where the caller raised: it may have missed what was moved
                if places is not None and (now := shard_places_now(self._reading)) != places:
                    self._places = now
                    raise StoreError("a shard of the store was moved while it was read; retry")
        except (SQLAlchemyError, UnicodeDecodeError) as error:
            raise StoreError(f"{self}: the store cannot be read: {explain(error)}") from error

    def check(self) -> None:
        """Check that the store can be read and, after a fault, written.

        Raises:
            StoreError: It is not ready.
        """
        with self.read():
            pass
        for each in self._writers:
            if each.fault is not None:
                _wait(self, each.submit(lambda _: None))

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
        for each in self._writers:
            each.close()
        if self._notices is not None:
            self._notices.close()
        self._dispose()

    def _dispose(self) -> None:
        for engine in (self._writing, *self._of_slots, self._reading):
            engine.dispose()


def _wait(store: Store, written: Future[T]) -> T:
    """Wait until a write is durable.

    Raises:
        StoreError: The commit takes too long, or the write fails.
    """
    try:
        return written.result(_WRITE_TIMEOUT_S)
    except TimeoutError as error:
        written.cancel()
        raise StoreError(
            f"{store}: nothing was written for {_WRITE_TIMEOUT_S:g} s; "
            "check what else uses the store, then retry"
        ) from error


def _clear(cache: WriteCache, _: Connection) -> None:
    cache.clear()


def _shrink(connection: Connection) -> None:
    connection.exec_driver_sql("PRAGMA shrink_memory")
