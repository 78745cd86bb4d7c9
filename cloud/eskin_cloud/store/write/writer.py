"""The writer: jobs share a commit, and each future is done after it."""

from __future__ import annotations

import logging
import queue
import threading
from concurrent.futures import Future
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Final, TypeVar

from eskin.errors import EskinError, StoreError
from eskin_cloud.store.db_errors import explain, is_store_fault

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable
    from collections.abc import Set as AbstractSet

    from sqlalchemy import Connection, Engine

log = logging.getLogger(__name__)

T = TypeVar("T")
_MOST_SHARED: Final = 32


@dataclass(frozen=True, slots=True)
class _Job:
    attempts: tuple[Callable[[Connection], Any], ...]
    future: Future[Any]
    shared: bool
    slots: AbstractSet[int]
    group: int


class Writer:
    """Runs jobs and commits them together; a failed job is rolled back alone.

    Args:
        engine: With one connection.
        capacity: Most jobs that may wait.
        on_begin: Called at the beginning of each transaction, with the slots of its jobs.
        on_save: Called before the commit, and around each job in a savepoint, to write cached
            changes.
        on_commit: Called after a commit, before the futures of its jobs are done.
        on_rollback: Called after a rollback, to clear caches.
        on_fault: Called after the store failed.
        probe: Writes a little. It runs first after a fault, so that a job which writes nothing
            cannot clear the fault.
        threaded: Whether a thread runs the jobs. Without one, `submit` runs them in the caller's
            thread, of which there must be only one.

    Attributes:
        fault: Why the last commit failed; ``None`` after a success.
        commits: Number of commits.
        jobs: Number of committed jobs.
    """

    def __init__(  # noqa: PLR0913 - all that a transaction calls
        self,
        engine: Engine,
        *,
        capacity: int,
        on_begin: Callable[[Connection, AbstractSet[int]], None],
        on_save: Callable[[Connection], None],
        on_commit: Callable[[], None],
        on_rollback: Callable[[], None],
        on_fault: Callable[[], None],
        probe: Callable[[Connection, AbstractSet[int]], None],
        threaded: bool = True,
    ) -> None:
        self._engine = engine
        self._jobs: queue.Queue[_Job | None] = queue.Queue(capacity)
        self._on_begin = on_begin
        self._on_save = on_save
        self._on_commit = on_commit
        self._on_rollback = on_rollback
        self._on_fault = on_fault
        self._probe = probe
        self._closing = threading.Event()
        self._lock = threading.Lock()
        self.fault: str | None = None
        self.commits = 0
        self.jobs = 0
        self._thread: threading.Thread | None = None
        if threaded:
            self._thread = threading.Thread(target=self._run, name="store writer", daemon=True)
            self._thread.start()

    @property
    def waiting(self) -> int:
        """Number of waiting jobs."""
        return self._jobs.qsize()

    def submit(
        self,
        work: Callable[[Connection], T],
        *,
        fallback: Callable[[Connection], T] | None = None,
        shared: bool = False,
        slots: Collection[int] = (),
        group: int = 0,
    ) -> Future[T]:
        """Queue a job; its future is done after the commit.

        Args:
            work: The job.
            slots: Those of the nodes whose rows it writes.
            group: That of the slots: no transaction has jobs of two groups.
            fallback: Runs instead if ``work`` raises anything but an `EskinError`.
            shared: Whether the job needs no savepoint. If a shared job fails, the transaction is
                rolled back, and each of its jobs runs in a transaction of its own.

        Raises:
            StoreError: Too many jobs wait, or the store is closed.
        """
        future: Future[T] = Future()
        with self._lock:
            if self._closing.is_set():
                raise StoreError("the store is closed")
            try:
                attempts = (work,) if fallback is None else (work, fallback)
                self._jobs.put_nowait(_Job(attempts, future, shared, frozenset(slots), group))
            except queue.Full:
                raise StoreError(
                    f"{self._jobs.maxsize} writes wait already; retry in an instant"
                ) from None
        if self._thread is None:
            self._run_once()
        return future

    def close(self) -> None:
        """Run waiting jobs, then stop."""
        with self._lock:
            self._closing.set()
        if self._thread is not None:
            self._jobs.put(None)
            self._thread.join()

    def _run(self) -> None:
        while self._run_once():
            pass

    def _run_once(self) -> bool:
        """Commit what waits, or the next job that comes; returns whether the writer goes on."""
        batch: list[_Job] = []
        running = _collect(self._jobs.get(), batch)
        while running and len(batch) < _MOST_SHARED:
            try:
                following = self._jobs.get_nowait()
            except queue.Empty:
                break
            running = _collect(following, batch)
        for jobs in _by_group(batch):
            self._commit(jobs)
        return running

    def _commit(self, batch: list[_Job]) -> Exception | None:
        """Run and commit jobs; returns the error with which all of them failed."""
        done: list[tuple[_Job, Any]] = []
        working = False
        try:
            with self._engine.begin() as connection:
                slots = frozenset[int]().union(*(job.slots for job in batch))
                self._on_begin(connection, slots)
                if self.fault is not None:
                    self._probe(connection, slots)
                working = True
                for job in batch:
                    self._do(connection, job, done)
                self._on_save(connection)
                working = False
        except Exception as error:  # noqa: BLE001 - fails the jobs, not the thread
            if working and _is_of_shared_work(batch, error):
                return self._redo(batch, error)
            self._fail(batch, error)
            return error
        self._on_commit()
        self.fault = None
        self.commits += 1
        self.jobs += len(done)
        for job, result in done:
            job.future.set_result(result)
        return None

    def _do(self, connection: Connection, job: _Job, done: list[tuple[_Job, Any]]) -> None:
        if job.shared:
            done.append((job, job.attempts[0](connection)))
            return
        self._on_save(connection)  # changes of earlier jobs, which a rollback of this one must keep
        for attempt in job.attempts:
            savepoint = connection.begin_nested()
            try:
                result = attempt(connection)
                self._on_save(connection)
            except Exception as error:
                if is_store_fault(error):
                    raise  # no job is committed
                savepoint.rollback()
                self._on_rollback()
                if attempt is job.attempts[-1] or isinstance(error, EskinError):
                    job.future.set_exception(error)
                    return
                log.exception("job failed, running its fallback")
            else:
                savepoint.commit()
                done.append((job, result))
                return

    def _redo(self, batch: list[_Job], error: Exception) -> Exception | None:
        """After a rollback by a failed shared job, run each job in its own transaction."""
        log.warning(
            "shared job failed, running each job alone: jobs=%d", len(batch), exc_info=error
        )
        self._on_rollback()
        waiting = [replace(job, shared=False) for job in batch if not job.future.done()]
        while waiting:
            broken = self._commit([waiting.pop(0)])
            if broken is not None:  # the store failed: the others would wait for the same timeout
                self._fail(waiting, broken)
                return broken
        return None

    def _fail(self, batch: list[_Job], error: Exception) -> None:
        if not is_store_fault(error) and not isinstance(error, StoreError):
            log.error("commit failed", exc_info=error)
        self._on_rollback()
        cause = explain(error)
        self.fault = f"the store cannot be written: {cause}"
        self._on_fault()
        log.error("commit failed: jobs=%d reason=%s", len(batch), cause)
        for job in batch:
            if not job.future.done():
                failure = StoreError(f"{self.fault}; then retry")
                failure.__cause__ = error
                job.future.set_exception(failure)


def _by_group(batch: list[_Job]) -> Iterable[list[_Job]]:
    """The jobs of each group, in order."""
    jobs: dict[int, list[_Job]] = {}
    for job in batch:
        jobs.setdefault(job.group, []).append(job)
    return jobs.values()


def _is_of_shared_work(batch: list[_Job], error: Exception) -> bool:
    return any(job.shared for job in batch) and not is_store_fault(error)


def _collect(job: _Job | None, batch: list[_Job]) -> bool:
    """Add a job unless it was cancelled; returns whether the writer goes on."""
    if job is None:
        return False
    if job.future.set_running_or_notify_cancel():
        batch.append(job)
    return True
