"""A gate before each statement, at which a unit waits until the scheduler lets it go on.

A unit is one cloud that does one thing. It logs in to the server by a name of its own, which states
its connections from those of other units, here and in the server's views.
"""

from __future__ import annotations

import threading
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, Final
from weakref import WeakKeyDictionary

from eskin_cloud.store.pg_copy import CopyStream, finish_copy
from eskin_cloud.store.schema.tables import feed
from sqlalchemy import Engine, event

from tests.robustness.interleavings.steps import TABLES, Step, read_statement

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from sqlalchemy import Connection, Table

_WRITTEN: Final = "written by the transaction"
_SEEN: Final = "has a snapshot"
_ELSEWHERE: Final = "in other slots"
_LOCAL: Final = ("SAVEPOINT", "RELEASE SAVEPOINT", "ROLLBACK TO SAVEPOINT", "SELECT max(versions")


class Gate:
    """Where units wait.

    Statements that no order can change do not stop: those of a read transaction after its first,
    which all see one snapshot; savepoints; the schema's version; transactions of slots that no
    other unit writes; and what touches only tables that are not `shared`.

    Args:
        slots: Those that the units write.

    Attributes:
        shared: The tables that a unit writes and another touches; ``None`` for all.
        seen: The steps that came by while nothing was to stop, for `find_shared`.
    """

    def __init__(self, slots: Sequence[int]) -> None:
        self._slots = frozenset(slots)
        self._changed = threading.Condition()
        self._units: dict[str, str] = {}
        self._waiting: dict[str, list[Step]] = {}
        self._ended: set[str] = set()
        self._stopping = False
        self.shared: frozenset[str] | None = None
        self.seen: list[Step] | None = None

    @contextmanager
    def installed(self) -> Iterator[None]:
        """Stand before all statements of the process."""
        streams: WeakKeyDictionary[CopyStream, Connection] = WeakKeyDictionary()
        copying: Any = CopyStream
        opening, finishing = copying.__init__, copying.finish

        def open_copy(stream: CopyStream, connection: Connection, table: Table) -> None:
            opening(stream, connection, table)
            streams[stream] = connection

        def finish(stream: CopyStream) -> None:
            connection = streams.pop(stream, None)
            if connection is not None:  # rows wait in memory until here
                self._write(connection, f"COPY {stream.table.name}")
            finishing(stream)

        listeners: dict[str, Callable[..., None]] = {
            "begin": self._begin,
            "before_cursor_execute": self._execute,
            "commit": self._commit,
            "rollback": self._rollback,
        }
        for name, listener in listeners.items():
            event.listen(Engine, name, listener)
        copying.__init__, copying.finish = open_copy, finish
        try:
            yield
        finally:
            copying.__init__, copying.finish = opening, finishing
            for name, listener in listeners.items():
                event.remove(Engine, name, listener)

    def arm(self, units: dict[str, str]) -> None:
        """Stop units from now on.

        Args:
            units: Their names, by their login.
        """
        with self._changed:
            self._units = units
            self._waiting = {name: [] for name in units.values()}
            self._ended = set()
            self._stopping = True

    def open(self) -> None:
        """Let all go on without a stop."""
        with self._changed:
            self._stopping = False
            for steps in self._waiting.values():
                steps.clear()
            self._changed.notify_all()

    def end(self, unit: str) -> None:
        """A unit has done all."""
        with self._changed:
            self._ended.add(unit)
            self._changed.notify_all()

    def release(self, unit: str) -> Step:
        """Let a waiting unit take its step; returns it."""
        with self._changed:
            step = self._waiting[unit].pop(0)
            self._changed.notify_all()
        return step

    def waiting(self) -> dict[str, Step]:
        """The next step of each unit that waits here."""
        with self._changed:
            return {
                unit: steps[0]
                for unit, steps in self._waiting.items()
                if steps and unit not in self._ended
            }

    def running(self) -> set[str]:
        """Units that neither wait here nor have ended."""
        with self._changed:
            return self._running()

    def settle(self, seconds: float, *, but: set[str]) -> set[str]:
        """Wait until no unit runs, except some; returns those that still do after a time."""
        with self._changed:
            self._changed.wait_for(lambda: not self._running() - but, seconds)
            return self._running()

    def _running(self) -> set[str]:
        waiting = {unit for unit, steps in self._waiting.items() if steps}
        return set(self._waiting) - waiting - self._ended

    def _stop(self, step: Step) -> None:
        with self._changed:
            if not self._stopping:
                return
            if self.seen is not None:
                self.seen.append(step)
                return
            if self.shared is not None and step.touches.isdisjoint(self.shared):
                return
            mine = self._waiting[step.unit]
            mine.append(step)
            self._changed.notify_all()
            while any(each is step for each in mine):
                self._changed.wait()

    def _unit(self, connection: Connection) -> str | None:
        return self._units.get(str(connection.engine.url.username))

    def _begin(self, connection: Connection) -> None:
        if self._unit(connection) is not None:
            connection.info[_WRITTEN] = frozenset()
            connection.info[_SEEN] = connection.info[_ELSEWHERE] = False

    def _execute(
        self, connection: Connection, _: object, statement: str, parameters: Any, *__: object
    ) -> None:
        unit = self._unit(connection)
        if unit is None:
            return
        if _only_reads(connection):
            if self.seen is not None:
                self._stop(read_statement(unit, statement))
            elif not connection.info[_SEEN]:
                connection.info[_SEEN] = True
                self._stop(Step(unit, "read transaction", TABLES))
            return
        finish_copy(connection)  # a step of its own
        if statement.startswith(_LOCAL):
            return
        if "FOR UPDATE" in statement and f"FROM {feed.name}" in statement:
            locked = {value for value in parameters.values() if isinstance(value, int)}
            connection.info[_ELSEWHERE] = self._slots.isdisjoint(locked)
        self._write(connection, statement)

    def _write(self, connection: Connection, statement: str) -> None:
        unit = self._unit(connection)
        if unit is None or connection.info[_ELSEWHERE]:
            return
        step = read_statement(unit, statement)
        connection.info[_WRITTEN] |= step.writes
        self._stop(step)

    def _commit(self, connection: Connection) -> None:
        if self._unit(connection) is not None and not _only_reads(connection):
            finish_copy(connection)
            self._end(connection, "COMMIT")

    def _rollback(self, connection: Connection) -> None:
        if self._unit(connection) is not None and not _only_reads(connection):
            self._end(connection, "ROLLBACK")

    def _end(self, connection: Connection, text: str) -> None:
        unit, written = self._unit(connection), connection.info.get(_WRITTEN, frozenset())
        if unit is not None and written and not connection.info[_ELSEWHERE]:
            self._stop(Step(unit, text, publishes=written))


def find_shared(seen: Sequence[Step]) -> frozenset[str]:
    """The tables that a unit writes and another touches, as far as they were seen."""
    touching: dict[str, set[str]] = {}
    writing: dict[str, set[str]] = {}
    for step in seen:
        for table in step.touches:
            touching.setdefault(table, set()).add(step.unit)
        for table in step.writes:
            writing.setdefault(table, set()).add(step.unit)
    return frozenset(table for table in writing if len(touching[table]) > 1)


def _only_reads(connection: Connection) -> bool:
    driver: Any = connection.connection.driver_connection
    return bool(driver.info.parameter_status("default_transaction_read_only") == "on")
