"""The one thread that writes: several jobs share one commit, and none is answered before it."""

from __future__ import annotations

import logging
import queue
import threading
from concurrent.futures import Future
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Final, TypeVar

from sqlalchemy.exc import SQLAlchemyError

from eskin.errors import EskinError, StoreError
from eskin_cloud.store.db_errors import explain, is_of_the_store

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
    together: bool


class Writer:
    """Runs jobs and commits them together; each is undone alone where it breaks.

    Args:
        engine: With one connection.
        capacity: Jobs that may wait.
        on_begin: Called at the beginning of each transaction.
        on_save: Called before its end, and around each job that is done for itself, to write what
            is only remembered yet.
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
        on_save: Callable[[Connection], None],
        on_rollback: Callable[[], None],
        probe: Callable[[Connection], None],
    ) -> None:
        self._engine = engine
        self._jobs: queue.Queue[_Job | None] = queue.Queue(capacity)
        self._on_begin = on_begin
        self._on_save = on_save
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
        self,
        work: Callable[[Connection], T],
        *,
        instead: Callable[[Connection], T] | None = None,
        together: bool = False,
    ) -> Future[T]:
        """Have work done within a transaction; the future is done after its commit.

        Args:
            work: What is done.
            instead: Done where that broke by an error that is none of ours: what nobody foresaw.
            together: Whether jobs like it need no savepoint between them, as they rarely break.
                Where one does, the whole transaction is undone, and each job is done for itself.

        Raises:
            StoreError: Too many wait, or the store is closed.
        """
        future: Future[T] = Future()
        with self._lock:
            if self._closing.is_set():
                raise StoreError("the store is closed; nothing more is written")
            try:
                ways = (work,) if instead is None else (work, instead)
                self._jobs.put_nowait(_Job(ways, future, together))
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

    def _commit(self, batch: list[_Job]) -> Exception | None:
        """Do jobs and commit them; gives why that failed, which each of them was told."""
        done: list[tuple[_Job, Any]] = []
        working = False
        try:
            with self._engine.begin() as connection:
                self._on_begin(connection)
                if self.fault is not None:
                    self._probe(connection)
                working = True
                for job in batch:
                    self._do(connection, job, done)
                self._on_save(connection)
                working = False
        except Exception as error:  # noqa: BLE001 - each job is told, and the thread goes on
            if working and _is_of_shared_work(batch, error):
                return self._redo(batch, error)
            self._fail(batch, error)
            return error
        self.fault = None
        self.commits += 1
        self.jobs += len(done)
        for job, result in done:
            job.future.set_result(result)
        return None

    def _do(self, connection: Connection, job: _Job, done: list[tuple[_Job, Any]]) -> None:
        if job.together:
            done.append((job, job.ways[0](connection)))
            return
        self._on_save(connection)  # of the jobs before: this one may be undone without them
        for way in job.ways:
            savepoint = connection.begin_nested()
            try:
                result = way(connection)
                self._on_save(connection)
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

    def _redo(self, batch: list[_Job], error: Exception) -> Exception | None:
        """Nothing is committed, as somebody's work broke: do each job for itself."""
        log.warning("shared work broke, doing %d jobs one by one", len(batch), exc_info=error)
        self._on_rollback()
        waiting = [replace(job, together=False) for job in batch if not job.future.done()]
        while waiting:
            broken = self._commit([waiting.pop(0)])
            if broken is not None:  # what made this one wait shall not make others wait, too
                self._fail(waiting, broken)
                return broken
        return None

    def _fail(self, batch: list[_Job], error: Exception) -> None:
        if not isinstance(error, SQLAlchemyError | StoreError | MemoryError | OSError):
            log.error("commit broke", exc_info=error)  # and the thread goes on
        self._on_rollback()
        cause = explain(error)
        self.fault = f"the store cannot be written: {cause}"
        log.error("commit failed: jobs=%d reason=%s", len(batch), cause)
        for job in batch:
            if not job.future.done():
                failure = StoreError(f"{self.fault}; then send again")
                failure.__cause__ = error
                job.future.set_exception(failure)


def _is_of_shared_work(batch: list[_Job], error: Exception) -> bool:
    return any(job.together for job in batch) and not is_of_the_store(error)


def _collect(job: _Job | None, batch: list[_Job]) -> bool:
    """Add a job unless its caller went away; gives whether more may come."""
    if job is None:
        return False
    if job.future.set_running_or_notify_cancel():
        batch.append(job)
    return True
