"""Processor time for a million samples, of one cloud and of several on one PostgreSQL server.

``python -m benchmarks.clouds`` starts 1, 2 and 4 clouds, each a process of its own. As many
gateways bring the same frames over TLS, each those of a part of the nodes, to the clouds of their
slots. A request has as many frames, of as many nodes, whatever the number of clouds. The time of
all clouds and of the server is counted, from the first request to the last answer. No cloud
compacts frames meanwhile.

Clouds and servers also work while nothing comes: they look for silent nodes, for work of their jobs
and for lost notifications. On two cores, four clouds do so four times in the time in which they
bring what one cloud alone brings, and not a quarter of it. So a second row is without what they
take in as many idle seconds.

With ``--citus`` the store of K clouds is distributed over K servers. The coordinator counts, too.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from itertools import groupby, islice, zip_longest
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING, Final

import cbor2
import psutil

from benchmarks.report import Row
from benchmarks.said import HAND, descriptions, say
from eskin.wire.slot import even_groups, slot_of
from tests.support.citus import CitusCluster
from tests.support.identities import Identities
from tests.support.postgresql import Cluster
from tests.unit.cloud.service import Service

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    import httpx

_CLOUDS: Final = (1, 2, 4)
_ROUNDS: Final = 3
_NODES: Final = 64
_FRAMES: Final = 150
"""Of each node and round: all nodes bring 9.6 million samples."""
_AT_ONCE: Final = 8
"""Frames of each node in a request, which has those of four nodes."""
_NODES_OF_REQUEST: Final = 4
_IDLE_S: Final = 10.0
_IN_FLIGHT: Final = 2
"""Requests of a gateway."""
_MILLIONS: Final = _NODES * _FRAMES * HAND.samples / 1e6
"""Of samples in a round."""
_MOST: Final = 1.15
_NO_COMPACTION: Final = "[compaction]\non = false\n"
"""Each cloud compacts a quarter of the time at most: more clouds would do more of it meanwhile."""


CITUS_HELP: Final = "programs of a PostgreSQL with Citus, as services/citus/build.sh prints them"


def measure_clouds(folder: Path, citus: Path | None = None, *, in_turn: bool = False) -> list[Row]:
    """CPU seconds for a million samples, medians of rounds, as multiples of those of one cloud.

    Args:
        folder: For settings and logs.
        citus: Folder of the programs of a PostgreSQL with Citus, on which K clouds have K workers;
            without it, clouds have one server.
        in_turn: Whether gateways bring their frames one after the other, so that the processes of
            one cloud at a time share the cores.
    """
    whole: dict[int, list[float]] = {number: [] for number in _CLOUDS}
    busy: dict[int, list[float]] = {number: [] for number in _CLOUDS}
    with ExitStack() as stack:
        sites = {number: _Site(folder / str(number), number, stack, citus) for number in _CLOUDS}
        for turn in range(_ROUNDS + 1):
            for number, site in sites.items():
                used, took_s = site.bring(turn, in_turn=in_turn)
                if turn:  # the first one compiles and warms up
                    whole[number].append(used / _MILLIONS)
                    busy[number].append((used - took_s * site.idle()) / _MILLIONS)
    servers = "one server" if citus is None else "as many shards on servers of their own"
    return [
        _row(f"{words}, {number} clouds on {servers}", number, seconds)
        for words, seconds in (
            ("CPU for a million samples", whole),
            ("the same without what they take while idle", busy),
        )
        for number in _CLOUDS
    ]


def _row(name: str, number: int, seconds: dict[int, list[float]]) -> Row:
    one, these = median(seconds[1]), median(seconds[number])
    return Row(
        name,
        round(these, 3),
        "s",
        peer="one cloud",
        peer_value=round(one, 3),
        ratio=round(one / these, 2),
        target=None if number == 1 else round(1 / _MOST, 2),
        met=None if number == 1 else these <= _MOST * one,
    )


class _Site:
    """Clouds with a store of their own, and as many gateways."""

    def __init__(self, folder: Path, number: int, stack: ExitStack, citus: Path | None) -> None:
        folder.mkdir(parents=True)
        cluster: Cluster
        if citus is None:
            cluster = stack.enter_context(Cluster())
            self._servers = [cluster.running]
        else:
            cluster = stack.enter_context(CitusCluster(citus, workers=number))
            self._servers = [each.running for each in (cluster, *cluster.workers)]
        identities, place = Identities(folder / "pki"), cluster.fresh()
        self._clouds = [
            stack.enter_context(
                Service(folder / f"cloud-{k}", identities, place=place, more=_NO_COMPACTION)
            )
            for k in range(number)
        ]
        self._gateways = [
            [stack.enter_context(each.gateway_client()) for each in self._clouds]
            for _ in range(number)
        ]
        nodes = [f"node-{k}" for k in range(_NODES)]
        self._clouds[0].admit(*nodes)
        for node in nodes:
            body = cbor2.dumps([[node, each] for each in descriptions(HAND)])
            self._gateways[0][0].post("/api/v1/descriptions", content=body).raise_for_status()
        self._nodes = [nodes[k::number] for k in range(number)]

    def bring(self, boot: int, *, in_turn: bool) -> tuple[float, float]:
        """Bring a boot of each node; gives CPU seconds, and those of the clock."""
        number = len(self._clouds)
        requests = [list(_requests(nodes, boot, number)) for nodes in self._nodes]
        before, begun = self._used(), time.perf_counter()
        with ThreadPoolExecutor(1 if in_turn else number) as pool:
            list(pool.map(_post_all, self._gateways, requests))
        return self._used() - before, time.perf_counter() - begun

    def idle(self) -> float:
        """CPU seconds in each second in which nothing comes."""
        before, begun = self._used(), time.perf_counter()
        time.sleep(_IDLE_S)
        return (self._used() - before) / (time.perf_counter() - begun)

    def _used(self) -> float:
        """Processor time of the clouds and of the servers, with all their sessions."""
        processes = [each.process for each in (*self._clouds, *self._servers)]
        return sum(_time_of(psutil.Process(each.pid)) for each in processes if each is not None)


def _time_of(process: psutil.Process) -> float:
    """Processor time of a process and of its children, those that have ended included."""
    try:
        times, children = process.cpu_times(), process.children()
    except psutil.NoSuchProcess:  # its parent has its time
        return 0.0
    ended = times.children_user + times.children_system
    return float(times.user + times.system + ended + sum(map(_time_of, children)))


def _requests(nodes: Sequence[str], boot: int, clouds: int) -> Iterator[tuple[int, bytes]]:
    """A gateway's requests, with the cloud of each: those of different clouds in turn."""
    said = [data for _, data in say(HAND, _FRAMES, boot=boot)]
    groups = even_groups(clouds)
    by_cloud = sorted(nodes, key=lambda node: groups[slot_of(node)])
    parts = [
        [
            (
                cloud,
                cbor2.dumps([[node, data] for data in said[at : at + _AT_ONCE] for node in some]),
            )
            for some in _batched(list(own), _NODES_OF_REQUEST)
            for at in range(0, _FRAMES, _AT_ONCE)
        ]
        for cloud, own in groupby(by_cloud, key=lambda node: groups[slot_of(node)])
    ]
    return (each for turn in zip_longest(*parts) for each in turn if each is not None)


def _batched(nodes: Sequence[str], size: int) -> Iterator[Sequence[str]]:
    return (nodes[first : first + size] for first in range(0, len(nodes), size))


def _post_all(clients: Sequence[httpx.Client], requests: Sequence[tuple[int, bytes]]) -> None:
    def post(request: tuple[int, bytes]) -> httpx.Response:
        cloud, body = request
        return clients[cloud].post("/api/v1/ingest", content=body)

    left = iter(requests)
    with ThreadPoolExecutor(_IN_FLIGHT) as pool:
        while some := list(islice(left, _IN_FLIGHT)):
            for answer in pool.map(post, some):
                assert answer.status_code == 200, answer.text
                assert {item["result"] for item in answer.json()["items"]} == {"stored"}


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("--citus", type=Path, metavar="PROGRAMS", help=CITUS_HELP)
    parser.add_argument("--in-turn", action="store_true", help="one gateway after the other")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="clouds-") as folder:
        for row in measure_clouds(Path(folder), arguments.citus, in_turn=arguments.in_turn):
            print(f"{row.name}: {row.value:g} {row.unit}, ratio {row.ratio}, target {row.target}")


if __name__ == "__main__":
    main()
