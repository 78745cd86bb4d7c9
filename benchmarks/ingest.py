"""Frames into both stores and over HTTPS, beside what others do with as many samples.

``python -m benchmarks.ingest`` measures them alone. Every commit is durable everywhere. A sample is
an interval: two numbers. All take turns, three times, so that a noisy machine is noisy for all;
rows have the median. The processor's time is measured, too, as other processes hardly change it.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING, Any, Final, Protocol

import cbor2
from eskin_cloud.store import Store
from eskin_cloud.store.descriptions import read_description, store_descriptions
from eskin_cloud.store.write.ingest import STORED, ingest
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
from benchmarks.said import HAND, NODE, SKIN, START, descriptions, say
from eskin.runtime.memory import freeze_gc
from eskin.wire.slot import slot_of
from tests.support.identities import Identities
from tests.support.postgresql import Cluster
from tests.unit.cloud.service import Service

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    import httpx
    from eskin_cloud.store.location import StoreLocation

    from benchmarks.said import Case

_SAMPLES: Final = 2_000_000
"""Of a round of ours; a request has a tenth of them."""
_BATCHES: Final = 10
_ROUNDS: Final = 3
_STORED: Final = {HAND: 10.0, SKIN: 20.0}
_POSTED: Final = 5.0
_SAMPLE_BYTES: Final = 2
_TARGETS: Final[dict[type, float | None]] = {
    SQLiteRows: 13.0,
    PostgreSQLRows: 13.0,
    InfluxDB: 13.0,
    DuckDBRows: 3.0,
    ChDBRows: 3.0,
    BareFile: None,
}
"""How many times as fast as each peer."""


class Subject(Protocol):
    """One way of ours; `run` gives millions of samples a second.

    Attributes:
        name: As the table shows it.
        target: The least rate.
        busy: Millions of samples a second of this process's processor time, by round.
    """

    name: str
    target: float
    busy: list[float]

    def run(self, number: int) -> float:
        """One round."""
        ...


class Stored:
    """From bytes to a durable row: each message is read and checked, then stored."""

    def __init__(self, name: str, place: StoreLocation, case: Case, stack: ExitStack) -> None:
        self.name = f"frames into {name}, {case.name}"
        self.target = _STORED[case]
        self.busy: list[float] = []
        self._case = case
        self._store = store = stack.enter_context(Store(place, queue=_BATCHES + 1))
        known = [read_description(data) for data in descriptions(case)]
        store.write_node(
            NODE, lambda connection, _: store_descriptions(connection, NODE, known)
        ).result(600)

    def run(self, number: int) -> float:
        """Batches are read while those before them are written."""
        batches, samples = _said(self._case, number)
        store = self._store

        def keep(batch: list[tuple[str, bytes]]) -> Callable[[Any, Any], object]:
            items = [ParsedMessage.parse(*each) for each in batch]
            return lambda connection, cache: ingest(
                connection, cache, items, gateway="g", now=START, dead_letters=1
            )

        def work() -> None:
            for future in [
                store.write_slots([slot_of(NODE)], keep(batch), shared=True) for batch in batches
            ]:
                outcome: Any = future.result(600)
                assert {receipt.result for receipt in outcome.results} == {STORED}

        used = time.process_time()
        rate = _rate(work, samples)
        self.busy.append(samples / (time.process_time() - used) / 1e6)
        return rate


class Posted:
    """Over TLS, with a gateway's certificate, to a cloud of its own process."""

    target = _POSTED

    def __init__(
        self, name: str, place: StoreLocation | None, folder: Path, stack: ExitStack
    ) -> None:
        self.name = f"the same over HTTPS into {name}, {HAND.name}"
        self.busy: list[float] = []
        folder.mkdir()
        service = stack.enter_context(Service(folder, Identities(folder / "pki"), place=place))
        self._client = stack.enter_context(service.gateway_client())
        self._pool = stack.enter_context(ThreadPoolExecutor(2))
        service.admit(NODE)
        body = cbor2.dumps([[NODE, each] for each in descriptions(HAND)])
        self._client.post("/api/v1/descriptions", content=body).raise_for_status()

    def run(self, number: int) -> float:
        """Two connections at once."""
        batches, samples = _said(HAND, number)
        bodies = [cbor2.dumps([list(one) for one in batch]) for batch in batches]

        def work() -> None:
            for answer in self._pool.map(self._post, bodies):
                assert answer.status_code == 200, answer.text
                assert {item["result"] for item in answer.json()["items"]} == {STORED}

        return _rate(work, samples)

    def _post(self, body: bytes) -> httpx.Response:
        return self._client.post("/api/v1/ingest", content=body)


def _said(case: Case, boot: int) -> tuple[list[list[tuple[str, bytes]]], int]:
    """Batches of a round, and their samples."""
    each = _SAMPLES // case.samples // _BATCHES
    said = say(case, each * _BATCHES, boot=boot)
    batches = [said[at : at + each] for at in range(0, len(said), each)]
    return batches, len(said) * case.samples


def measure_ingest(folder: Path) -> list[Row]:
    """Millions of samples a second, of each way of ours and of each peer.

    Args:
        folder: For the stores.
    """
    folder.mkdir()
    with ExitStack() as stack:
        cluster = stack.enter_context(Cluster())
        subjects: list[Subject] = [
            Stored(name, place, case, stack)
            for number, case in enumerate((HAND, SKIN))
            for name, place in (
                ("SQLite", folder / f"{number}.sqlite"),
                ("PostgreSQL", cluster.fresh()),
            )
        ]
        subjects += [
            Posted("SQLite", None, folder / "file", stack),
            Posted("PostgreSQL", cluster.fresh(), folder / "server", stack),
        ]
        peers: list[Peer] = [
            SQLiteRows(folder, stack),
            PostgreSQLRows(cluster.fresh(empty=True), stack),
            InfluxDB(folder, stack),
            DuckDBRows(folder, stack),
            ChDBRows(folder, stack),
            BareFile(folder, _SAMPLE_BYTES, stack),
        ]
        return _rows(subjects, peers, *_take_turns(subjects, peers))


def _take_turns(
    subjects: Sequence[Subject], peers: Sequence[Peer]
) -> tuple[list[float], list[float]]:
    """Median rates; the first round of all compiles, and is not counted.

    After it the process settles, as a cloud does after its start: Python would look for garbage
    among all that peers' libraries brought, at the cost of what stores then.
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
        if not subject.busy:
            continue
        rows.append(Row(f"{subject.name}, a second of CPU", median(subject.busy[1:]), unit))
        for peer, other in zip(peers, theirs, strict=True):
            ratio, target = rate / other, _TARGETS[type(peer)]
            met = None if target is None else ratio >= target
            rows.append(Row(subject.name, rate, unit, peer.name, other, ratio, target, met))
    return rows


def _rate(work: Callable[[], object], samples: int) -> float:
    begun = time.perf_counter()
    work()
    return samples / (time.perf_counter() - begun) / 1e6


def main() -> None:
    """Measure, and say so line by line."""
    argparse.ArgumentParser(prog="python -m benchmarks.ingest", description=__doc__).parse_args()
    with tempfile.TemporaryDirectory(prefix="eskin-ingest-") as folder:
        rows = measure_ingest(Path(folder) / "stores")
    for row in rows:
        peer = f"; {row.peer}: {row.peer_value:.3g}" if row.peer_value is not None else ""
        met = "" if row.met is None else " (met)" if row.met else " (NOT met)"
        print(f"{row.name}: {row.value:.3g} {row.unit}{peer}{met}")


if __name__ == "__main__":
    main()
