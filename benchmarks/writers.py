"""How often K clouds commit on one PostgreSQL server whose disk is slow, against one cloud.

``python -m benchmarks.writers`` adds 40 ms to each flush of the server. Each writer is a process
with a store of its own, and writes the nodes of its own slots: one batch after the other, each of
which is durable before the next begins. Meanwhile locks that a session waits for are counted.
"""

from __future__ import annotations

import argparse
import multiprocessing
import subprocess
import tempfile
import time
from itertools import count
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING, Final

import psycopg
from eskin_cloud.store import Store
from eskin_cloud.store.slot import even_groups, slot_of
from eskin_cloud.store.write.parsed_message import ParsedMessage
from sqlalchemy import make_url

from benchmarks.report import Row
from tests.support.postgresql import Cluster
from tests.unit.cloud.clouds import put_items
from tests.unit.cloud.messages import stretch

if TYPE_CHECKING:
    from collections.abc import Callable
    from multiprocessing.synchronize import Event

_FLUSH_MS: Final = 40
_MESSAGES: Final = 3
"""Of a batch."""
_SECONDS: Final = 5.0
_WRITERS: Final = (1, 2, 4)
_ROUNDS: Final = 3
_LEAST: Final = 0.8
_WAITING: Final = b"SELECT count(*) FROM pg_locks WHERE NOT granted AND locktype <> 'object'"


def measure_writers(flush_ms: int = _FLUSH_MS) -> list[Row]:
    """Commits a second of K writers as multiples of one, medians of rounds; and waits for locks.

    The server's own limit is measured beside: sessions that insert one row a transaction, without
    any lock of ours. A session whose commit comes while a flush is under way waits for the next.

    Args:
        flush_ms: What each flush takes longer.
    """
    ours: dict[int, list[float]] = {number: [] for number in _WRITERS}
    bare: dict[int, list[float]] = {number: [] for number in _WRITERS}
    shared: list[float] = []
    waits = 0
    with tempfile.TemporaryDirectory(prefix="flush-") as folder:
        Path(folder).chmod(0o755)
        library = _compiled(Path(folder))
        prefix = ["env", f"LD_PRELOAD={library}", f"SLOW_FLUSH_MS={flush_ms}"]
        with Cluster(prefix=prefix) as cluster:
            # So that commits share flushes, as PostgreSQL's manual advises for slow disks.
            for setting in (f"commit_delay = {200 * flush_ms}", "commit_siblings = 1"):
                cluster.execute(f"ALTER SYSTEM SET {setting}", database="postgres")
            cluster.execute("SELECT pg_reload_conf()", database="postgres")
            for _ in range(_ROUNDS):
                for number in _WRITERS:
                    nodes = [_node(k, number) for k in range(number)]
                    rate, waited = _rate(cluster, _write, nodes)
                    ours[number].append(rate)
                    bare[number].append(_rate(cluster, _insert, nodes)[0])
                    waits += waited
                shared.append(_rate(cluster, _write, [_node(0, 1)] * 2)[0])
            cluster.running.kill()  # a last checkpoint would take minutes
    one, rows = median(ours[1]), []
    for number in _WRITERS[1:]:
        ratio = median(ours[number]) / one
        most = median(bare[number]) / median(bare[1])
        rows += [
            Row(
                f"commits of {number} clouds in slots of their own, {flush_ms} ms a flush",
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


def _compiled(folder: Path) -> Path:
    source = Path(__file__).with_name("slow_flush.c")
    made = folder / "slow_flush.so"
    subprocess.run(["cc", "-shared", "-fPIC", "-o", made, source, "-ldl"], check=True)
    return made


def _node(number: int, among: int) -> str:
    """A node of which so many writers have one each, in slots of their own."""
    names = (f"node-{k}" for k in count())
    return next(each for each in names if even_groups(among)[slot_of(each)] == number)


def _rate(cluster: Cluster, work: Callable[..., None], nodes: list[str]) -> tuple[float, int]:
    """Commits a second of one writer for each node, and how often a lock was waited for."""
    place = cluster.fresh()
    context = multiprocessing.get_context("spawn")
    ready = [context.Event() for _ in nodes]
    begin, stored = context.Event(), [context.Value("q", 0) for _ in nodes]
    url = place.render_as_string(hide_password=False)
    writers = [
        context.Process(target=work, args=(url, node, 1000 * k, is_ready, begin, own))
        for k, (node, is_ready, own) in enumerate(zip(nodes, ready, stored, strict=True))
    ]
    for each in writers:
        each.start()
    for event in ready:
        assert event.wait(120), "a writer is ready"
    begin.set()
    waits, begun = 0, time.monotonic()
    words = f"host={cluster.folder} user={place.username} dbname={place.database}"
    with psycopg.connect(words, autocommit=True) as connection:
        while time.monotonic() - begun < _SECONDS:
            waits += connection.execute(_WAITING).fetchone()[0]  # type: ignore[index]  # one row
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
    place, row = make_url(url), b"INSERT INTO bare VALUES (%s, %s)"
    words = f"host={place.query['host']} user={place.username} dbname={place.database}"
    with psycopg.connect(words, autocommit=True) as connection:
        connection.execute(b"CREATE TABLE IF NOT EXISTS bare (node text, boot bigint)")
        ready.set()
        assert begin.wait(120)
        end = time.monotonic() + _SECONDS
        while time.monotonic() < end:
            connection.execute(row, (node, boot))
            stored.value += 1  # type: ignore[attr-defined]  # a shared number


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("--flush-ms", type=int, default=_FLUSH_MS, help="default %(default)s")
    for row in measure_writers(parser.parse_args().flush_ms):
        print(f"{row.name}: {row.value:g} {row.unit}, ratio {row.ratio}, target {row.target}")


if __name__ == "__main__":
    main()
