"""The one thread that writes: several jobs share one commit, and none is answered before it."""

from __future__ import annotations

import logging
import queue
import threading
from concurrent.futures import Future
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, TypeVar

from sqlalchemy.exc import SQLAlchemyError

from cloud.store.faults import explain, is_of_the_store
from eskin.errors import EskinError, StoreError

if TYPE_CHECKING:
    from collections.abc import Callable

    from sqlalchemy import Connection, Engine

log = logging.getLogger(__name__)

T = TypeVar("T")
_MOST_SHARED: Final = 32


@dataclass(frozen=True, slots=True)
class _Job:
    ways: tuple[Callable[[Connection], Any], ...]
    future: Future[Any]


class Writer:
    """Runs jobs, each within a savepoint, and commits them together.

    Args:
        engine: With one connection.
        capacity: Jobs that may wait.
        on_begin: Called at the beginning of each transaction.
        on_rollback: Called when what jobs did was undone, so that caches are forgotten.
        probe: Writes a little; after a fault it must succeed, lest a job that writes nothing
            passes for a store that is well again.

    Attributes:
        fault: Why the last commit failed; ``None`` once one succeeded again.
        commits: How many commits there were.
        jobs: How many jobs they held.
    """

    def __init__(
        self,
        engine: Engine,
        *,
        capacity: int,
        on_begin: Callable[[Connection], None],
        on_rollback: Callable[[], None],
        probe: Callable[[Connection], None],
    ) -> None:
        self._engine = engine
        self._jobs: queue.Queue[_Job | None] = queue.Queue(capacity)
        self._on_begin = on_begin
        self._on_rollback = on_rollback
        self._probe = probe
        self._closing = threading.Event()
        self._lock = threading.Lock()
        self.fault: str | None = None
        self.commits = 0
        self.jobs = 0
        self._thread = threading.Thread(target=self._run, name="store writer", daemon=True)
        self._thread.start()

    @property
    def waiting(self) -> int:
        """Jobs that wait."""
        return self._jobs.qsize()

    def submit(
        self, work: Callable[[Connection], T], *, instead: Callable[[Connection], T] | None = None
    ) -> Future[T]:
        """Have work done within a transaction; the future is done after its commit.

        Args:
            work: What is done.
            instead: Done where that broke by an error that is none of ours: what nobody foresaw.

        Raises:
            StoreError: Too many wait, or the store is closed.
        """
        future: Future[T] = Future()
        with self._lock:
            if self._closing.is_set():
                raise StoreError("the store is closed; nothing more is written")
            try:
                ways = (work,) if instead is None else (work, instead)
                self._jobs.put_nowait(_Job(ways, future))
            except queue.Full:
                raise StoreError(
                    f"{self._jobs.maxsize} writes wait already; try again in a moment"
                ) from None
        return future

    def close(self) -> None:
        """Do what waits, then stop."""
        with self._lock:
            self._closing.set()
        self._jobs.put(None)
        self._thread.join()

    def _run(self) -> None:
        running = True
        while running:
            first = self._jobs.get()
            batch: list[_Job] = []
            running = _collect(first, batch)
            while running and len(batch) < _MOST_SHARED:
                try:
                    following = self._jobs.get_nowait()
                except queue.Empty:
                    break
                running = _collect(following, batch)
            if batch:
                self._commit(batch)

    def _commit(self, batch: list[_Job]) -> None:
        done: list[tuple[_Job, Any]] = []
        try:
            with self._engine.begin() as connection:
                self._on_begin(connection)
                if self.fault is not None:
                    self._probe(connection)
                for job in batch:
                    self._do(connection, job, done)
        except (SQLAlchemyError, StoreError, MemoryError, OSError) as error:
            self._fail(batch, error)
            return
        except Exception as error:  # nothing is committed either, and the thread goes on
            log.exception("commit broke")
            self._fail(batch, error)
            return
        self.fault = None
        self.commits += 1
        self.jobs += len(done)
        for job, result in done:
            job.future.set_result(result)

    def _do(self, connection: Connection, job: _Job, done: list[tuple[_Job, Any]]) -> None:
        for way in job.ways:
            savepoint = connection.begin_nested()
            try:
                result = way(connection)
            except Exception as error:
                if is_of_the_store(error):
                    raise  # nobody's work is committed
                savepoint.rollback()
                self._on_rollback()
                if way is job.ways[-1] or isinstance(error, EskinError):
                    job.future.set_exception(error)
                    return
                log.exception("work failed, trying it in parts")
            else:
                savepoint.commit()
                done.append((job, result))
                return

    def _fail(self, batch: list[_Job], error: Exception) -> None:
        self._on_rollback()
        cause = explain(error)
        self.fault = f"the store cannot be written: {cause}"
        log.error("commit failed: jobs=%d reason=%s", len(batch), cause)
        for job in batch:
            if not job.future.done():
                failure = StoreError(f"{self.fault}; then send again")
                failure.__cause__ = error
                job.future.set_exception(failure)


def _collect(job: _Job | None, batch: list[_Job]) -> bool:
    """Add a job unless its caller went away; gives whether more may come."""
    if job is None:
        return False
    if job.future.set_running_or_notify_cancel():
        batch.append(job)
    return True
