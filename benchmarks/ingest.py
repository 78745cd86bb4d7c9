"""Ingest: blocks into both stores and over HTTPS, beside databases with one row a sample.

Every commit is durable everywhere. A sample is an interval: two numbers.
"""

from __future__ import annotations

import sqlite3
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from itertools import islice
from typing import TYPE_CHECKING, Any, Final

import cbor2
import duckdb
import numpy as np
import psycopg
import pyarrow as pa

from benchmarks.report import Row
from cloud.store import Store
from cloud.store.intake import Item, take_in
from eskin.messages import Encoding
from tests.cloud.messages import START, block
from tests.cloud.service import Service
from tests.identities import Identities
from tests.postgresql import Cluster

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from cloud.store.place import Place

_SAMPLES: Final = 500
_BATCH: Final = 500
_CHANNELS: Final = 4
_STORED: Final = 10.0
_POSTED: Final = 5.0
_PEER_SHARE: Final = 8
_TABLE: Final = (
    "CREATE TABLE sample (channel TEXT, t BIGINT, lo DOUBLE PRECISION, hi DOUBLE PRECISION, "
    "PRIMARY KEY (channel, t))"
)


def measure_ingest(folder: Path, *, blocks: int) -> list[Row]:
    """Millions of samples a second; peers are given a part of the samples, for they are slower."""
    folder.mkdir()
    said = list(islice(_blocks(), blocks))
    few = blocks // _PEER_SHARE * _SAMPLES
    with Cluster() as cluster:
        ours = {
            "SQLite": _store(folder / "ours.sqlite", said),
            "PostgreSQL": _store(cluster.fresh(), said),
        }
        posted = {
            "SQLite": _post(folder / "file", None, said),
            "PostgreSQL": _post(folder / "server", cluster.fresh(), said),
        }
        empty = cluster.fresh(empty=True)
        words = f"host={cluster.folder} user={empty.username} dbname={empty.database}"
        peers = {
            "SQLite, a row a sample": _rate(lambda: _into_sqlite(folder / "rows.sqlite", few), few),
            "PostgreSQL, a row a sample (COPY)": _rate(lambda: _into_postgresql(words, few), few),
            "DuckDB, a row a sample (Arrow)": _rate(lambda: _into_duckdb(folder / "d", few), few),
        }
    return [
        *_rows("interval samples into {}", ours, _STORED, peers),
        *_rows("the same over HTTPS into {}", posted, _POSTED, {}),
    ]


def _rows(name: str, found: dict[str, float], target: float, peers: dict[str, float]) -> list[Row]:
    unit = "Msamples/s"
    rows = []
    for store, rate in found.items():
        title = name.format(store)
        rows.append(Row(title, rate, unit, target=target, met=rate >= target))
        rows += [
            Row(title, rate, unit, peer, other, rate / other, 1.0, rate >= other)
            for peer, other in peers.items()
        ]
    return rows


def _blocks() -> Iterator[tuple[str, bytes]]:
    random = np.random.default_rng(1)
    number = 0
    while True:
        lo = random.random(_SAMPLES)
        first = START + number // _CHANNELS * _SAMPLES * 1_000_000
        said = block(
            number,
            lo,
            lo + 1e-3,
            time=(first, first),
            channel=f"t{number % _CHANNELS:02}.capacitance",
            encoding=Encoding.F32,
        )
        yield "fingertip", said.encode()
        number += 1


def _rate(work: Callable[[], object], samples: int) -> float:
    begun = time.perf_counter()
    work()
    return samples / (time.perf_counter() - begun) / 1e6


def _store(place: Place, said: list[tuple[str, bytes]]) -> float:
    """Through the storage layer: messages are read already."""
    items = [Item.read(node, data) for node, data in said]
    batches = [items[at : at + _BATCH] for at in range(0, len(items), _BATCH)]
    with Store(place, queue=len(batches)) as store:

        def keep(batch: list[Item]) -> Callable[[Any], object]:
            return lambda connection: take_in(
                connection, store.ledger, batch, gateway="g", now=START, dead_letters=1
            )

        def work() -> None:
            for future in [store.write(keep(batch)) for batch in batches]:
                future.result(600)

        return _rate(work, len(said) * _SAMPLES)


def _post(folder: Path, place: Place | None, said: list[tuple[str, bytes]]) -> float:
    """Over TLS, with a gateway's token, to a cloud of its own process."""
    folder.mkdir()
    bodies = [
        cbor2.dumps([list(one) for one in said[at : at + _BATCH]])
        for at in range(0, len(said), _BATCH)
    ]
    with (
        Service(folder, Identities(folder / "pki"), place=place) as service,
        ThreadPoolExecutor(2) as pool,
    ):

        def work() -> None:
            answers = pool.map(service.ingest, bodies)
            assert {answer.status_code for answer in answers} == {200}

        return _rate(work, len(said) * _SAMPLES)


def _samples(count: int) -> Iterator[tuple[list[str], Any, Any, Any]]:
    """Columns of as many samples as a batch of blocks has, again and again."""
    random = np.random.default_rng(1)
    size = _BATCH * _SAMPLES
    for first in range(0, count, size):
        n = min(size, count - first)
        lo = random.random(n)
        yield ["t00.capacitance"] * n, np.arange(first, first + n), lo, lo + 1e-3


def _into_sqlite(path: Path, count: int) -> None:
    with closing(sqlite3.connect(path)) as database:
        database.execute("PRAGMA journal_mode=WAL")
        database.execute("PRAGMA synchronous=FULL")
        database.execute(_TABLE)
        for channel, t, lo, hi in _samples(count):
            rows = zip(channel, t.tolist(), lo.tolist(), hi.tolist(), strict=True)
            database.executemany("INSERT INTO sample VALUES (?, ?, ?, ?)", rows)
            database.commit()


def _into_postgresql(words: str, count: int) -> None:
    with psycopg.connect(words) as connection:
        connection.execute(_TABLE)
        for channel, t, lo, hi in _samples(count):
            with connection.cursor().copy("COPY sample FROM STDIN (FORMAT BINARY)") as copy:
                copy.set_types(["text", "int8", "float8", "float8"])
                for row in zip(channel, t.tolist(), lo.tolist(), hi.tolist(), strict=True):
                    copy.write_row(row)
            connection.commit()


def _into_duckdb(path: Path, count: int) -> None:
    with closing(duckdb.connect(str(path))) as database:
        database.execute(_TABLE)
        for channel, t, lo, hi in _samples(count):
            database.register("batch", pa.table({"channel": channel, "t": t, "lo": lo, "hi": hi}))
            database.execute("INSERT INTO sample SELECT * FROM batch")
