"""How often K clouds commit on one PostgreSQL server whose disk is slow, against one cloud.

``python -m benchmarks.writers`` adds 40 ms to each flush of the server. Each writer is a process
with a store of its own, and writes the nodes of its own slots: one batch after the other, each of
which is durable before the next begins. Meanwhile locks that a session waits for are counted.

With ``--citus`` the store is distributed over four servers, whose flushes are slow, and each
writer's nodes are in a shard of another server.
"""

from __future__ import annotations

import argparse
import multiprocessing
import tempfile
import time
from contextlib import ExitStack
from itertools import count
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING, Final, Self

import psycopg
from eskin_cloud.store import Store
from eskin_cloud.store.distribute import check
from eskin_cloud.store.write.parsed_message import ParsedMessage
from sqlalchemy import make_url

from benchmarks.clouds import CITUS_HELP
from benchmarks.report import Row
from eskin.wire.slot import even_groups, slot_of
from tests.support.citus import CitusCluster
from tests.support.postgresql import Cluster
from tests.support.preloads import build_preload
from tests.unit.cloud.clouds import put_items
from tests.unit.cloud.messages import stretch

if TYPE_CHECKING:
    from collections.abc import Callable
    from multiprocessing.synchronize import Event

    from sqlalchemy import URL

_FLUSH_MS: Final = 40
_MESSAGES: Final = 3
"""Of a batch."""
_SECONDS: Final = 5.0
_WRITERS: Final = (1, 2, 4)
_ROUNDS: Final = 3
_LEAST: Final = 0.8
_SLOW_FLUSH: Final = Path(__file__).with_name("slow_flush.c")
_WAITING: Final = b"SELECT count(*) FROM pg_locks WHERE NOT granted AND locktype <> 'object'"


def measure_writers(flush_ms: int = _FLUSH_MS, citus: Path | None = None) -> list[Row]:
    """Commits a second of K writers as multiples of one, medians of rounds; and waits for locks.

    The server's own limit is measured beside: sessions that insert one row a transaction, without
    any lock of ours. A session whose commit comes while a flush is under way waits for the next.

    Args:
        flush_ms: What each flush takes longer.
        citus: Folder of the programs of a PostgreSQL with Citus; without it, there is one server.
    """
    ours: dict[int, list[float]] = {number: [] for number in _WRITERS}
    bare: dict[int, list[float]] = {number: [] for number in _WRITERS}
    shared: list[float] = []
    waits = 0
    with _Place(flush_ms, citus) as place:
        for _ in range(_ROUNDS):
            for number in _WRITERS:
                rate, waited = place.rate(_write, place.nodes(number))
                ours[number].append(rate)
                bare[number].append(place.rate(_insert, place.nodes(number))[0])
                waits += waited
            shared.append(place.rate(_write, place.nodes(1) * 2)[0])
    one, rows = median(ours[1]), []
    for number in _WRITERS[1:]:
        ratio = median(ours[number]) / one
        most = median(bare[number]) / median(bare[1])
        apart = "slots of their own" if citus is None else "shards of servers of their own"
        rows += [
            Row(
                f"commits of {number} clouds in {apart}, {flush_ms} ms a flush",
                round(median(ours[number]), 1),
                "1/s",
                peer="one cloud",
                peer_value=round(one, 1),
                ratio=round(ratio, 2),
                target=_LEAST * number,
                met=ratio >= _LEAST * number,
            ),
            Row(f"the same of {number} sessions that insert a row", round(most, 2), "times one"),
        ]
    both = Row("commits of 2 clouds in one slot", round(median(shared) / one, 2), "times one")
    return [*rows, both, Row("waits for locks between writers of different slots", waits, "")]


class _Place:
    """A store on servers whose flushes are slow."""

    def __init__(self, flush_ms: int, citus: Path | None) -> None:
        self._flush_ms = flush_ms
        self._citus = citus
        self._stack = ExitStack()
        self._boots = count(1)

    def __enter__(self) -> Self:
        with ExitStack() as stack:
            folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="flush-")))
            folder.chmod(0o755)
            environment = [
                f"LD_PRELOAD={build_preload(_SLOW_FLUSH, folder)}",
                f"SLOW_FLUSH_MS={self._flush_ms}",
            ]
            prefix = ["env", *environment]
            if self._citus is None:
                cluster = stack.enter_context(Cluster(prefix=prefix))
                self._clusters = [cluster]
            else:
                most = max(_WRITERS)
                cluster = stack.enter_context(
                    CitusCluster(self._citus, workers=most, prefix=prefix)
                )
                self._clusters = [cluster, *cluster.workers]
            self._url = cluster.fresh()
            self._slots = [] if self._citus is None else [e.slots for e in check(self._url)]
            database = str(self._url.database)
            cluster.execute("CREATE TABLE bare (slot integer, boot bigint)", database=database)
            if self._citus is not None:
                spread = "SELECT create_distributed_table('bare', 'slot', colocate_with => 'feed')"
                cluster.execute(spread, database=database)
            for each in self._clusters:
                stack.callback(each.running.kill)  # a last checkpoint would take minutes
                # So that commits share flushes, as PostgreSQL's manual advises for slow disks.
                for setting in (f"commit_delay = {200 * self._flush_ms}", "commit_siblings = 1"):
                    each.execute(f"ALTER SYSTEM SET {setting}", database="postgres")
                each.execute("SELECT pg_reload_conf()", database="postgres")
            self._stack = stack.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def nodes(self, number: int) -> list[str]:
        """A node for each of so many writers, in slots of their own; on Citus, of other servers."""
        groups = even_groups(number)
        whose = self._slots or [
            frozenset(slot for slot, group in enumerate(groups) if group == k)
            for k in range(number)
        ]
        return [
            next(node for k in count() if slot_of(node := f"node-{k}") in slots)
            for slots in whose[:number]
        ]

    def rate(self, work: Callable[..., None], nodes: list[str]) -> tuple[float, int]:
        """Commits a second of one writer for each node, and how often a lock was waited for."""
        context = multiprocessing.get_context("spawn")
        ready = [context.Event() for _ in nodes]
        begin, stored = context.Event(), [context.Value("q", 0) for _ in nodes]
        url = self._url.render_as_string(hide_password=False)
        writers = [
            context.Process(target=work, args=(url, node, next(self._boots), is_ready, begin, own))
            for node, is_ready, own in zip(nodes, ready, stored, strict=True)
        ]
        for each in writers:
            each.start()
        for event in ready:
            assert event.wait(120), "a writer is ready"
        begin.set()
        waits, begun = 0, time.monotonic()
        with ExitStack() as stack:
            name = str(self._url.database)
            watchers = [stack.enter_context(_session(c.place(name))) for c in self._clusters]
            while time.monotonic() - begun < _SECONDS:
                for watcher in watchers:
                    waits += watcher.execute(_WAITING).fetchone()[0]  # type: ignore[index]  # a row
                time.sleep(0.005)
        for each in writers:
            each.join(120)
            assert each.exitcode == 0, "a writer failed"
        return sum(each.value for each in stored) / _SECONDS, waits


def _write(url: str, node: str, boot: int, ready: Event, begin: Event, stored: object) -> None:
    with Store(make_url(url)) as store:
        put_items(store, [ParsedMessage.parse(node, stretch(0, boot=boot).encode())])
        ready.set()
        assert begin.wait(120)
        end, sequence = time.monotonic() + _SECONDS, 1
        while time.monotonic() < end:
            numbers = range(sequence, sequence + _MESSAGES)
            items = [ParsedMessage.parse(node, stretch(n, boot=boot).encode()) for n in numbers]
            results = put_items(store, items).results
            assert all(each.result == "stored" for each in results)
            if time.monotonic() < end:
                stored.value += 1  # type: ignore[attr-defined]  # a shared number
            sequence += _MESSAGES


def _insert(url: str, node: str, boot: int, ready: Event, begin: Event, stored: object) -> None:
    row = b"INSERT INTO bare VALUES (%s, %s)"
    with _session(make_url(url)) as connection:
        ready.set()
        assert begin.wait(120)
        end = time.monotonic() + _SECONDS
        while time.monotonic() < end:
            connection.execute(row, (slot_of(node), boot))
            stored.value += 1  # type: ignore[attr-defined]  # a shared number


def _session(place: URL) -> psycopg.Connection:
    port = f" port={place.port}" if place.port else ""
    words = f"host={place.query['host']}{port} user={place.username} dbname={place.database}"
    return psycopg.connect(words, autocommit=True)


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("--flush-ms", type=int, default=_FLUSH_MS, help="default %(default)s")
    parser.add_argument("--citus", type=Path, metavar="PROGRAMS", help=CITUS_HELP)
    arguments = parser.parse_args()
    for row in measure_writers(arguments.flush_ms, arguments.citus):
        print(f"{row.name}: {row.value:g} {row.unit}, ratio {row.ratio}, target {row.target}")


if __name__ == "__main__":
    main()
