"""What others do with the same samples: a row each, or bare bytes; every commit is durable.

Each peer is given batches of samples in the form that it takes fastest; where that form is text, it
is written beforehand.
"""

from __future__ import annotations

import os
import shutil
import sqlite3
from contextlib import ExitStack, closing
from typing import TYPE_CHECKING, Any, Final, Protocol

import duckdb
import httpx
import numpy as np
import psycopg
import pyarrow as pa
from chdb import session

from tests.support.processes import Running, accepts, free_port

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from sqlalchemy import URL

BATCH: Final = 250_000
"""Samples a batch."""
_CHANNEL: Final = "t00.capacitance"
_TABLE: Final = (
    "CREATE TABLE sample (channel TEXT, t BIGINT, lo DOUBLE PRECISION, hi DOUBLE PRECISION, "
    "PRIMARY KEY (channel, t))"
)
_open_chdb: Final[Any] = session.Session  # it is not typed
_LINES: Final = 25_000
"""Of InfluxDB's line protocol, in one request: five times what its manual advises at least."""


class Peer(Protocol):
    """Stores samples.

    Attributes:
        name: As the table shows it.
        samples: How many a round takes: fewer for the slow.
    """

    name: str
    samples: int

    def prepare(self, first: int) -> None:
        """Make what a round needs: samples from this number on."""
        ...

    def store(self) -> None:
        """Store them."""
        ...


class Columns:
    """Samples in columns, for a peer that turns them into its own form.

    Args:
        samples: A round's.
    """

    def __init__(self, samples: int) -> None:
        self.samples = samples
        self._batches: list[tuple[list[str], Any, Any, Any]] = []

    def prepare(self, first: int) -> None:
        """Draw them."""
        random = np.random.default_rng(first)
        self._batches = []
        for begin in range(first, first + self.samples, BATCH):
            lo = random.random(BATCH)
            instants = np.arange(begin, begin + BATCH)
            self._batches.append(([_CHANNEL] * BATCH, instants, lo, lo + 1e-3))

    def rows(self) -> Iterator[Iterator[tuple[str, int, float, float]]]:
        """Each batch as rows."""
        for channel, t, lo, hi in self._batches:
            yield zip(channel, t.tolist(), lo.tolist(), hi.tolist(), strict=True)

    def tables(self) -> Iterator[pa.Table]:
        """Each batch as an Arrow table."""
        for channel, t, lo, hi in self._batches:
            yield pa.table({"channel": channel, "t": t, "lo": lo, "hi": hi})


class SQLiteRows(Columns):
    """SQLite, by a prepared statement."""

    name = "SQLite, a row a sample"

    def __init__(self, folder: Path, stack: ExitStack) -> None:
        super().__init__(2 * BATCH)
        self._database = stack.enter_context(closing(sqlite3.connect(folder / "rows.sqlite")))
        for words in ("PRAGMA journal_mode=WAL", "PRAGMA synchronous=FULL", _TABLE):
            self._database.execute(words)

    def store(self) -> None:
        """Insert them."""
        for rows in self.rows():
            self._database.executemany("INSERT INTO sample VALUES (?, ?, ?, ?)", rows)
            self._database.commit()


class PostgreSQLRows(Columns):
    """PostgreSQL, by COPY."""

    name = "PostgreSQL, a row a sample (COPY)"

    def __init__(self, place: URL, stack: ExitStack) -> None:
        super().__init__(2 * BATCH)
        words = f"host={place.query['host']} user={place.username} dbname={place.database}"
        self._connection = stack.enter_context(psycopg.connect(words))
        self._connection.execute(_TABLE)
        self._connection.commit()

    def store(self) -> None:
        """Copy them."""
        for rows in self.rows():
            with self._connection.cursor().copy("COPY sample FROM STDIN (FORMAT BINARY)") as copy:
                copy.set_types(["text", "int8", "float8", "float8"])
                for row in rows:
                    copy.write_row(row)
            self._connection.commit()


class DuckDBRows(Columns):
    """DuckDB, from Arrow; without a key, as its manual advises for loading."""

    name = "DuckDB, a row a sample (Arrow)"

    def __init__(self, folder: Path, stack: ExitStack) -> None:
        super().__init__(40 * BATCH)
        self._database = stack.enter_context(closing(duckdb.connect(str(folder / "rows.duckdb"))))
        self._database.execute(_TABLE.replace(", PRIMARY KEY (channel, t)", ""))

    def store(self) -> None:
        """Insert them."""
        for table in self.tables():
            self._database.register("batch", table)
            self._database.execute("INSERT INTO sample SELECT * FROM batch")


class ChDBRows(Columns):
    """chDB (ClickHouse within the process), from Arrow."""

    name = "chDB, a row a sample (Arrow)"

    def __init__(self, folder: Path, stack: ExitStack) -> None:
        super().__init__(4 * BATCH)
        self._session = _open_chdb(str(folder / "chdb"))
        stack.callback(self._session.close)
        self._session.query("CREATE DATABASE b")
        self._session.query(
            "CREATE TABLE b.sample (channel String, t Int64, lo Float64, hi Float64) "
            "ENGINE = MergeTree ORDER BY (channel, t) "
            "SETTINGS fsync_after_insert = 1, fsync_part_directory = 1"
        )

    def store(self) -> None:
        """Insert them."""
        for batch in self.tables():  # noqa: B007 - chDB looks for it by its name
            self._session.query("INSERT INTO b.sample SELECT * FROM Python(batch)")


class InfluxDB:
    """InfluxDB 1 over HTTP on loopback, by the line protocol; its log is synced for each write."""

    name = "InfluxDB 1, a point a sample"
    samples = 2 * BATCH

    def __init__(self, folder: Path, stack: ExitStack) -> None:
        program = shutil.which("influxd")
        assert program is not None, "influxd is missing; install it (apt-get install influxdb)"
        ports = free_port(), free_port()
        data = folder / "influxdb"
        data.mkdir()
        (data / "influxdb.conf").write_text(
            f'reporting-enabled = false\nbind-address = "127.0.0.1:{ports[0]}"\n'
            f'[meta]\ndir = "{data}/meta"\n[data]\ndir = "{data}/data"\nwal-dir = "{data}/wal"\n'
            f'wal-fsync-delay = "0s"\n[http]\nbind-address = "127.0.0.1:{ports[1]}"\n'
            "log-enabled = false\n[monitor]\nstore-enabled = false\n"
        )
        words = [program, "run", "-config", str(data / "influxdb.conf")]
        running = stack.enter_context(Running(words, log=data / "log"))
        running.wait_for(lambda: accepts(ports[1]), "InfluxDB listens")
        base = f"http://127.0.0.1:{ports[1]}"
        self._client = stack.enter_context(httpx.Client(base_url=base, timeout=60))
        self._client.post("/query", params={"q": "CREATE DATABASE b"}).raise_for_status()
        self._bodies: list[bytes] = []

    def prepare(self, first: int) -> None:
        """Write the lines."""
        lows = np.random.default_rng(first).random(self.samples).tolist()
        lines = [
            f"sample,channel={_CHANNEL} lo={lo!r},hi={lo + 1e-3!r} {first + k}"
            for k, lo in enumerate(lows)
        ]
        parts = range(0, self.samples, _LINES)
        self._bodies = ["\n".join(lines[at : at + _LINES]).encode() for at in parts]

    def store(self) -> None:
        """Post them."""
        for body in self._bodies:
            self._client.post(
                "/write", params={"db": "b", "precision": "ns"}, content=body
            ).raise_for_status()


class BareFile:
    """A file to which bytes are appended and synced: what the disk alone costs."""

    name = "a bare file, appended and synced"
    samples = 40 * BATCH

    def __init__(self, folder: Path, sample_bytes: int, stack: ExitStack) -> None:
        self._file = stack.enter_context((folder / "bare").open("wb", buffering=0))
        self._batch = os.urandom(BATCH * sample_bytes)

    def prepare(self, first: int) -> None:
        """There is nothing to make."""

    def store(self) -> None:
        """Append and sync."""
        for _ in range(self.samples // BATCH):
            self._file.write(self._batch)
            os.fdatasync(self._file.fileno())
