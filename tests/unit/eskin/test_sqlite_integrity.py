"""A damaged file is found when it is opened; where only an index is damaged, nothing is lost."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from typing import TYPE_CHECKING

import pytest

from eskin.runtime.sqlite_integrity import require_whole

if TYPE_CHECKING:
    from pathlib import Path

BY_SHELF = "SELECT number FROM message INDEXED BY shelves WHERE shelf = 1 ORDER BY number"


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """A file whose index does not know of the last message, and knows of one that is gone."""
    path = tmp_path / "messages.db"
    with closing(sqlite3.connect(path, isolation_level=None)) as one:
        one.execute("CREATE TABLE message (number INTEGER PRIMARY KEY, shelf INTEGER NOT NULL)")
        one.execute("CREATE INDEX shelves ON message (shelf, number)")
        one.executemany("INSERT INTO message VALUES (?, 1)", [(1,), (2,)])
        (row,) = one.execute("SELECT * FROM sqlite_master WHERE name = 'shelves'")
        one.execute("PRAGMA writable_schema = ON")
        one.execute("DELETE FROM sqlite_master WHERE name = 'shelves'")
    with closing(sqlite3.connect(path, isolation_level=None)) as other:
        other.execute("DELETE FROM message WHERE number = 1")
        other.execute("INSERT INTO message VALUES (3, 1)")
        other.execute("PRAGMA writable_schema = ON")
        other.execute("INSERT INTO sqlite_master VALUES (?, ?, ?, ?, ?)", row)
    return path


def test_indexes_are_made_anew(path: Path, caplog: pytest.LogCaptureFixture) -> None:
    with closing(sqlite3.connect(path, isolation_level=None)) as connection:
        assert connection.execute(BY_SHELF).fetchall() == [(1,), (2,)]
        require_whole(connection)
        assert connection.execute(BY_SHELF).fetchall() == [(2,), (3,)]
        assert caplog.messages == [
            f"indexes did not fit their tables and were made anew: path={path}"
        ]
        caplog.clear()
        require_whole(connection)
        assert not caplog.messages


def test_damaged_table_is_refused(path: Path) -> None:
    with closing(sqlite3.connect(path, isolation_level=None)) as connection:
        connection.execute("PRAGMA writable_schema = ON")
        connection.execute(
            "UPDATE sqlite_master SET sql = replace(sql, 'shelf INTEGER', 'shelf TEXT') "
            "|| 'STRICT' WHERE name = 'message'"
        )
    with (
        closing(sqlite3.connect(path, isolation_level=None)) as connection,
        pytest.raises(sqlite3.DatabaseError, match=r"the file is damaged: .*; bring back a copy"),
    ):
        require_whole(connection)
