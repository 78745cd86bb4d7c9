"""Ingest: blocks into both stores and over HTTPS, beside what others do with the same samples.

Every commit is durable everywhere. A sample is an interval: two numbers. All take turns, three
times, so that a noisy machine is noisy for all; what is told is the median.
"""

from __future__ import annotations

import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from statistics import median
from typing import TYPE_CHECKING, Any, Final, Protocol

import cbor2
from eskin_cloud.store import Store
from eskin_cloud.store.write.ingest import ingest
from eskin_cloud.store.write.parsed_message import ParsedMessage

from benchmarks.report import Row
from benchmarks.row_stores import (
    BareFile,
    ChDBRows,
    DuckDBRows,
    InfluxDB,
    Peer,
    PostgreSQLRows,
    SQLiteRows,
)
from benchmarks.said import SAMPLES, say
from eskin.runtime.memory import freeze_gc
from eskin.wire.messages import Encoding
from tests.support.identities import Identities
from tests.support.postgresql import Cluster
from tests.unit.cloud.messages import START
from tests.unit.cloud.service import Service

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    import httpx
    from eskin_cloud.store.location import StoreLocation

    from benchmarks.said import Said

_BATCH: Final = 500
_ROUNDS: Final = 3
_STORED: Final = 10.0
_POSTED: Final = 5.0
_F32_BYTES: Final = 8
_TARGETS: Final[dict[type, float | None]] = {
    SQLiteRows: 13.0,
    PostgreSQLRows: 13.0,
    InfluxDB: 13.0,
    DuckDBRows: 2.0,
    ChDBRows: 2.0,
    BareFile: None,
}
"""How many times as fast as each peer."""


class Subject(Protocol):
    """One way of ours; `run` gives millions of samples a second."""

    name: str
    target: float

    def run(self, number: int) -> float:
        """One round."""
        ...


class Stored:
    """From bytes to a durable row: each message is read and checked, then stored."""

    target = _STORED

    def __init__(
        self, name: str, place: StoreLocation, encoding: Encoding, blocks: int, stack: ExitStack
    ) -> None:
        self.name = f"interval samples into {name}, {encoding.name.lower()}"
        self._encoding, self._blocks = encoding, blocks
        self._store = stack.enter_context(Store(place, queue=blocks // _BATCH + 1))

    def run(self, number: int) -> float:
        """Batches are read while those before them are written."""
        said = say(self._encoding, self._blocks, boot=number)
        batches = [said[at : at + _BATCH] for at in range(0, len(said), _BATCH)]
        store = self._store

        def keep(batch: Said) -> Callable[[Any], object]:
            items = ParsedMessage.parse_all(batch)
            return lambda connection: ingest(
                connection, store.cache, items, gateway="g", now=START, dead_letters=1
            )

        def work() -> None:
            for future in [store.write(keep(batch), shared=True) for batch in batches]:
                future.result(600)

        return _rate(work, len(said) * SAMPLES)


class Posted:
    """Over TLS, with a gateway's certificate, to a cloud of its own process."""

    target = _POSTED

    def __init__(
        self, name: str, place: StoreLocation | None, folder: Path, blocks: int, stack: ExitStack
    ) -> None:
        self.name = f"the same over HTTPS into {name}, f32"
        self._blocks = blocks
        folder.mkdir()
        self._service = stack.enter_context(
            Service(folder, Identities(folder / "pki"), place=place)
        )
        self._client = stack.enter_context(self._service.gateway_client())
        self._pool = stack.enter_context(ThreadPoolExecutor(2))

    def run(self, number: int) -> float:
        """Two connections at once."""
        said = say(Encoding.F32, self._blocks, boot=number)
        bodies = [
            cbor2.dumps([list(one) for one in said[at : at + _BATCH]])
            for at in range(0, len(said), _BATCH)
        ]

        self._service.admit(*{node for node, _ in said})

        def work() -> None:
            assert {answer.status_code for answer in self._pool.map(self._post, bodies)} == {200}

        return _rate(work, len(said) * SAMPLES)

    def _post(self, body: bytes) -> httpx.Response:
        return self._client.post("/api/v1/ingest", content=body)


def measure_ingest(folder: Path, *, blocks: int) -> list[Row]:
    """Millions of samples a second, of each way of ours and of each peer.

    Args:
        folder: For the stores.
        blocks: How many go into each of ours in a round, as many as DuckDB takes samples.
    """
    folder.mkdir()
    with ExitStack() as stack:
        cluster = stack.enter_context(Cluster())
        subjects: list[Subject] = [
            Stored(name, place, encoding, blocks, stack)
            for encoding in (Encoding.F32, Encoding.Q16)
            for name, place in (
                ("SQLite", folder / f"{encoding.name}.sqlite"),
                ("PostgreSQL", cluster.fresh()),
            )
        ]
        subjects += [
            Posted("SQLite", None, folder / "file", blocks, stack),
            Posted("PostgreSQL", cluster.fresh(), folder / "server", blocks, stack),
        ]
        peers: list[Peer] = [
            SQLiteRows(folder, stack),
            PostgreSQLRows(cluster.fresh(empty=True), stack),
            InfluxDB(folder, stack),
            DuckDBRows(folder, stack),
            ChDBRows(folder, stack),
            BareFile(folder, _F32_BYTES, stack),
        ]
        return _rows(subjects, peers, *_take_turns(subjects, peers))


def _take_turns(
    subjects: Sequence[Subject], peers: Sequence[Peer]
) -> tuple[list[float], list[float]]:
    """Median rates; the first round of all compiles, and is not counted.

    After it the process settles, as a cloud does after its start: Python would look for garbage
    among all that peers' libraries brought, at the cost of whoever stores then.
    """
    ours: list[list[float]] = [[] for _ in subjects]
    theirs: list[list[float]] = [[] for _ in peers]
    for number in range(_ROUNDS + 1):
        for rates, subject in zip(ours, subjects, strict=True):
            rates.append(subject.run(number))
        for rates, peer in zip(theirs, peers, strict=True):
            peer.prepare(number * peer.samples)
            rates.append(_rate(peer.store, peer.samples))
        if number == 0:
            freeze_gc()
    return [median(rates[1:]) for rates in ours], [median(rates[1:]) for rates in theirs]


def _rows(
    subjects: Sequence[Subject], peers: Sequence[Peer], ours: list[float], theirs: list[float]
) -> list[Row]:
    unit = "Msamples/s"
    rows = []
    for subject, rate in zip(subjects, ours, strict=True):
        rows.append(
            Row(subject.name, rate, unit, target=subject.target, met=rate >= subject.target)
        )
        if isinstance(subject, Posted):
            continue
        for peer, other in zip(peers, theirs, strict=True):
            ratio, target = rate / other, _TARGETS[type(peer)]
            met = None if target is None else ratio >= target
            rows.append(Row(subject.name, rate, unit, peer.name, other, ratio, target, met))
    return rows


def _rate(work: Callable[[], object], samples: int) -> float:
    begun = time.perf_counter()
    work()
    return samples / (time.perf_counter() - begun) / 1e6
