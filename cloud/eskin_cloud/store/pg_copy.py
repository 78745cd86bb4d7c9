"""PostgreSQL's COPY of rows, which goes on until its connection does anything else.

While a COPY goes on, its connection can run no statement. So what is rows goes to the server as
they come, and each statement, commit or rollback of SQLAlchemy's ends it first (`attend`).
"""

from __future__ import annotations

from contextlib import ExitStack, contextmanager, suppress
from typing import TYPE_CHECKING, Any, Final, Self

from sqlalchemy import BigInteger, Double, Integer, LargeBinary, event
from sqlalchemy.exc import DBAPIError

from eskin_cloud.store.schema.text_type import Text

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
"""What COPY's binary format calls our columns' types."""
_OPEN: Final = "copying"
"""Where a connection keeps its COPY."""


class Copying:
    """A COPY into a table (PostgreSQL's documentation, "COPY", "Binary Format").

    Attributes:
        table: The table.
        ended: Whether it takes no more rows.
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
        with self._ending_where_it_breaks():
            cursor = self._held.enter_context(driver.cursor())
            self._copy: Any = self._held.enter_context(cursor.copy(self._words))
            self._copy.set_types(types)

    @classmethod
    def into(cls, connection: Connection, table: Table) -> Self:
        """The connection's COPY into a table, which goes on or begins.

        Raises:
            DBAPIError: As from any other statement.
        """
        open_: Self | None = connection.info.get(_OPEN)
        if open_ is None or open_.ended or open_.table is not table:
            finish(connection)
            open_ = connection.info[_OPEN] = cls(connection, table)
        return open_

    def write(self, values: tuple[Any, ...]) -> None:
        """Write a row; it need not have come to the server yet.

        Raises:
            DBAPIError: As from any other statement.
        """
        try:
            self._copy.write_row(values)
        except BaseException:  # asked this way for each row: the other one costs as much as a row
            with self._ending_where_it_breaks():
                raise

    def finish(self) -> None:
        """End it, with all its rows in the table.

        Raises:
            DBAPIError: As from any other statement.
        """
        self.ended = True
        with self._ending_where_it_breaks():
            self._held.close()

    def abort(self, error: BaseException) -> None:
        """End it because something broke; the transaction is good for a rollback only."""
        self.ended = True
        with suppress(self._errors):
            self._held.__exit__(type(error), error, None)

    @contextmanager
    def _ending_where_it_breaks(self) -> Iterator[None]:
        """Nothing may leave it open: its driver's connection is locked until it ends."""
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


def attend(engine: Engine) -> None:
    """Have each of an engine's statements, commits and rollbacks end its connection's COPY."""

    @event.listens_for(engine, "before_cursor_execute")
    def execute(connection: Connection, *_: object) -> None:
        finish(connection)

    @event.listens_for(engine, "commit")
    def commit(connection: Connection) -> None:
        finish(connection)

    @event.listens_for(engine, "rollback")
    def rollback(connection: Connection) -> None:
        abort(connection)

    @event.listens_for(engine, "rollback_savepoint")
    def back(connection: Connection, *_: object) -> None:
        abort(connection)


def finish(connection: Connection) -> None:
    """End a connection's COPY, if one goes on, with all its rows in the table.

    Raises:
        DBAPIError: As from any other statement.
    """
    open_: Copying | None = connection.info.pop(_OPEN, None)
    if open_ is not None:
        open_.finish()


def abort(connection: Connection) -> None:
    """End a connection's COPY, if one goes on, for what it wrote is undone."""
    if connection.invalidated:
        return
    open_: Copying | None = connection.info.pop(_OPEN, None)
    if open_ is not None:
        open_.abort(InterruptedError("rolled back"))
