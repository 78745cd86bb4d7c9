"""Insert rows by PostgreSQL's COPY.

A connection in COPY mode can run no other statement. Rows are sent as they come; each statement,
commit or rollback of SQLAlchemy ends the COPY first (`end_copy_before_statements`).
"""

from __future__ import annotations

from contextlib import ExitStack, contextmanager, suppress
from typing import TYPE_CHECKING, Any, Final, Self

from sqlalchemy import BigInteger, Double, Integer, LargeBinary, event
from sqlalchemy.exc import DBAPIError

from eskin_cloud.store.text_type import Text

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sqlalchemy import Connection, Engine, Table

_TYPES: Final = {
    BigInteger: "int8",
    Double: "float8",
    Integer: "int4",
    LargeBinary: "bytea",
    Text: "text",
}
"""PostgreSQL's names of the column types."""
_KEY: Final = "copying"
"""Key of the stream in ``Connection.info``."""


class CopyStream:
    """A COPY into a table (PostgreSQL's documentation, "COPY", "Binary Format").

    Attributes:
        table: The table.
        ended: Whether the stream accepts no more rows.
    """

    def __init__(self, connection: Connection, table: Table) -> None:
        names = ", ".join(column.name for column in table.columns)
        self.table = table
        self.ended = False
        self._words = f"COPY {table.name} ({names}) FROM STDIN (FORMAT BINARY)"
        self._dialect = connection.dialect
        self._errors: type[Exception] = connection.dialect.loaded_dbapi.Error
        self._held = ExitStack()
        types = [_TYPES[type(column.type)] for column in table.columns]
        driver: Any = connection.connection.driver_connection
        with self._aborting_on_error():
            cursor = self._held.enter_context(driver.cursor())
            self._copy: Any = self._held.enter_context(cursor.copy(self._words))
            self._copy.set_types(types)

    @classmethod
    def open(cls, connection: Connection, table: Table) -> Self:
        """The connection's COPY into a table; begins one if needed.

        Raises:
            DBAPIError: As from any other statement.
        """
        stream: Self | None = connection.info.get(_KEY)
        if stream is None or stream.ended or stream.table is not table:
            finish_copy(connection)
            stream = connection.info[_KEY] = cls(connection, table)
        return stream

    def write(self, values: tuple[Any, ...]) -> None:
        """Send a row, without waiting for the server.

        Raises:
            DBAPIError: As from any other statement.
        """
        try:
            self._copy.write_row(values)
        except BaseException:  # a context manager for each row would cost as much as the row
            with self._aborting_on_error():
                raise

    def finish(self) -> None:
        """End the COPY and insert its rows.

        Raises:
            DBAPIError: As from any other statement.
        """
        self.ended = True
        with self._aborting_on_error():
            self._held.close()

    def abort(self, error: BaseException) -> None:
        """End the COPY after an error; the transaction can only be rolled back."""
        self.ended = True
        with suppress(self._errors):
            self._held.__exit__(type(error), error, None)

    @contextmanager
    def _aborting_on_error(self) -> Iterator[None]:
        """Abort on any error: an open COPY locks the driver's connection."""
        try:
            yield
        except self._errors as error:
            self.abort(error)
            raise DBAPIError.instance(
                self._words, None, error, self._errors, dialect=self._dialect
            ) from error
        except BaseException as error:
            self.abort(error)
            raise


def end_copy_before_statements(engine: Engine) -> None:
    """End a connection's COPY before each statement, commit and rollback of an engine."""

    @event.listens_for(engine, "before_cursor_execute")
    def execute(connection: Connection, *_: object) -> None:
        finish_copy(connection)

    @event.listens_for(engine, "commit")
    def commit(connection: Connection) -> None:
        finish_copy(connection)

    @event.listens_for(engine, "rollback")
    def rollback(connection: Connection) -> None:
        abort_copy(connection)

    @event.listens_for(engine, "rollback_savepoint")
    def back(connection: Connection, *_: object) -> None:
        abort_copy(connection)


def finish_copy(connection: Connection) -> None:
    """End a connection's COPY, if there is one, and insert its rows.

    Raises:
        DBAPIError: As from any other statement.
    """
    stream: CopyStream | None = connection.info.pop(_KEY, None)
    if stream is not None:
        stream.finish()


def abort_copy(connection: Connection) -> None:
    """Abort a connection's COPY, if there is one, before a rollback."""
    if connection.invalidated:
        return
    stream: CopyStream | None = connection.info.pop(_KEY, None)
    if stream is not None:
        stream.abort(InterruptedError("rolled back"))
