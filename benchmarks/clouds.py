"""Processor time for a million samples, of one cloud and of several on one PostgreSQL server.

``python -m benchmarks.clouds`` starts 1, 2 and 4 clouds, each a process of its own. As many
gateways bring the same frames over TLS, each those of its nodes to a cloud of its own. The time of
all clouds and of the server is counted, from the first request to the last answer. Nodes' slots
are as their names have them, so clouds write the same slots, and each drops what it has cached of
a slot that another one has written. No cloud compacts frames meanwhile.

With ``--citus`` the store of K clouds is distributed over K servers. The coordinator counts, too.
"""

from __future__ import annotations

import argparse
import tempfile
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from itertools import islice
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING, Final

import cbor2
import psutil

from benchmarks.report import Row
from benchmarks.said import HAND, descriptions, say
from tests.support.citus import CitusCluster
from tests.support.identities import Identities
from tests.support.postgresql import Cluster
from tests.unit.cloud.service import Service

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    import httpx

_CLOUDS: Final = (1, 2, 4)
_ROUNDS: Final = 3
_NODES: Final = 16
_FRAMES: Final = 600
"""Of each node and round: 16 nodes bring 9.6 million samples."""
_AT_ONCE: Final = 8
"""Frames of each node in a request, which has those of four nodes."""
_NODES_OF_REQUEST: Final = 4
_IN_FLIGHT: Final = 2
"""Requests of a gateway."""
_MOST: Final = 1.15
_NO_COMPACTION: Final = "[compaction]\non = false\n"
"""Each cloud compacts a quarter of the time at most: more clouds would do more of it meanwhile."""


CITUS_HELP: Final = "programs of a PostgreSQL with Citus, as services/citus/build.sh prints them"


def measure_clouds(folder: Path, citus: Path | None = None) -> list[Row]:
    """CPU seconds for a million samples, medians of rounds, as multiples of those of one cloud.

    Args:
        folder: For settings and logs.
        citus: Folder of the programs of a PostgreSQL with Citus, on which K clouds have K workers;
            without it, clouds have one server.
    """
    used: dict[int, list[float]] = {number: [] for number in _CLOUDS}
    with ExitStack() as stack:
        sites = {number: _Site(folder / str(number), number, stack, citus) for number in _CLOUDS}
        for turn in range(_ROUNDS + 1):
            for number, site in sites.items():
                seconds = site.bring(turn)
                if turn:  # the first one compiles and warms up
                    used[number].append(seconds)
    one = median(used[1])
    servers = "one server" if citus is None else "as many shards on servers of their own"
    return [
        Row(
            f"CPU for a million samples, {number} clouds on {servers}",
            round(median(used[number]), 3),
            "s",
            peer="one cloud",
            peer_value=round(one, 3),
            ratio=round(one / median(used[number]), 2),
            target=None if number == 1 else round(1 / _MOST, 2),
            met=None if number == 1 else median(used[number]) <= _MOST * one,
        )
        for number in _CLOUDS
    ]


class _Site:
    """Clouds with a store of their own, each with a gateway's client."""

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
        self._clients = [stack.enter_context(each.gateway_client()) for each in self._clouds]
        nodes = [f"node-{k}" for k in range(_NODES)]
        self._clouds[0].admit(*nodes)
        for node in nodes:
            body = cbor2.dumps([[node, each] for each in descriptions(HAND)])
            self._clients[0].post("/api/v1/descriptions", content=body).raise_for_status()
        self._nodes = [nodes[k::number] for k in range(number)]

    def bring(self, boot: int) -> float:
        """Bring a boot of each node; gives CPU seconds for a million samples."""
        bodies = [list(_requests(nodes, boot)) for nodes in self._nodes]
        before = self._used()
        with ThreadPoolExecutor(len(self._clients)) as pool:
            list(pool.map(_post_all, self._clients, bodies))
        return (self._used() - before) / (_NODES * _FRAMES * HAND.samples / 1e6)

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


def _requests(nodes: Sequence[str], boot: int) -> Iterator[bytes]:
    """The bodies of a gateway's requests."""
    said = [data for _, data in say(HAND, _FRAMES, boot=boot)]
    for first in range(0, len(nodes), _NODES_OF_REQUEST):
        some = nodes[first : first + _NODES_OF_REQUEST]
        for at in range(0, _FRAMES, _AT_ONCE):
            frames = said[at : at + _AT_ONCE]
            yield cbor2.dumps([[node, data] for data in frames for node in some])


def _post_all(client: httpx.Client, bodies: Sequence[bytes]) -> None:
    left = iter(bodies)
    with ThreadPoolExecutor(_IN_FLIGHT) as pool:
        while some := list(islice(left, _IN_FLIGHT)):
            for answer in pool.map(lambda body: client.post("/api/v1/ingest", content=body), some):
                assert answer.status_code == 200, answer.text
                assert {item["result"] for item in answer.json()["items"]} == {"stored"}


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("--citus", type=Path, metavar="PROGRAMS", help=CITUS_HELP)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="clouds-") as folder:
        for row in measure_clouds(Path(folder), arguments.citus):
            print(f"{row.name}: {row.value:g} {row.unit}, ratio {row.ratio}, target {row.target}")


if __name__ == "__main__":
    main()
