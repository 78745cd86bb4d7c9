"""A server of a Citus cluster is killed: data flow again, those of the other servers all along."""

from __future__ import annotations

import logging
import time
from contextlib import ExitStack
from itertools import count
from typing import TYPE_CHECKING, Final

import pytest
from eskin_cloud.store import Store
from eskin_cloud.store.distribute import check
from eskin_cloud.store.schema.node_key import of_node
from eskin_cloud.store.schema.tables import sequences
from sqlalchemy import func, select

from eskin.errors import StoreError
from eskin.wire.slot import slot_of
from tests.support.citus import CitusCluster
from tests.support.files import ask
from tests.support.live_viewers import LiveViewer, require_each_once
from tests.support.processes import wait_until
from tests.support.stacks import RealStack

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from tests.support.postgresql import Cluster

pytestmark = pytest.mark.cluster

log = logging.getLogger(__name__)

AGAIN_S: Final = 10.0
"""So soon after a server is back data flow again; `docs/high-availability.md` has what was
measured."""
PAUSE_S: Final = 3.0
"""The longest time without a new message of a node whose server lives."""
_MORE: Final = 20
"""Messages of about a second."""
_TIMES: Final = 3


class Flow:
    """How the messages of a node come to be stored.

    Args:
        store: The store.
        node: The node.

    Attributes:
        pause_s: The longest time without a new one.
        again_s: The seconds until there are 20 new ones; ``None`` until then.
    """

    def __init__(self, store: Store, node: str) -> None:
        self._store = store
        self._node = node
        self._last = self._first = self.count()
        self._begun = self._since = time.monotonic()
        self.pause_s = 0.0
        self.again_s: float | None = None

    def count(self) -> int:
        """How many messages of the node are stored; 0 where its server does not answer."""
        s = sequences.c
        query = select(func.sum(s.last - s.first + 1)).where(of_node(sequences, self._node))
        try:
            with self._store.read() as connection:
                return int(connection.execute(query).scalar_one() or 0)
        except StoreError:
            return 0

    def has_begun(self) -> bool:
        """Whether some messages are stored."""
        return self.count() > _MORE

    def look(self) -> None:
        """Look once."""
        found, now = self.count(), time.monotonic()
        self.pause_s = max(self.pause_s, now - self._since)
        if found > self._last:
            self._last, self._since = found, now
        if found >= self._first + _MORE and self.again_s is None:
            self.again_s = now - self._begun


def measure(store: Store, server: Cluster, nodes: Sequence[str], *, away_s: float) -> list[Flow]:
    """Kill a server, start it after a time, and look until messages of all nodes are stored."""
    flows = [Flow(store, node) for node in nodes]
    server.running.kill()
    begun, down = time.monotonic(), True

    def all_flow() -> bool:
        nonlocal down
        if down and time.monotonic() > begun + away_s:
            server.running.start()
            down = False
        for flow in flows:
            flow.look()
        return not down and all(flow.again_s is not None for flow in flows)

    wait_until(all_flow, "messages of all nodes are stored again", seconds=away_s + AGAIN_S)
    return flows


def log_flows(what: str, flows: Sequence[Flow]) -> None:
    """Log what was measured, for the table in `docs/high-availability.md`."""
    said = [f"again {flow.again_s:.1f} s, pause {flow.pause_s:.1f} s" for flow in flows]
    log.info("killed %s: %s", what, "; ".join(said))


def node_of(slots: frozenset[int]) -> str:
    """A node of one of these slots."""
    return next(name for k in count() if slot_of(name := f"node-{k}") in slots)


@pytest.mark.timeout(900)
def test_kill_of_a_server_stops_no_other_and_data_flow_again(
    tmp_path: Path, programs: Path
) -> None:
    with ExitStack() as running:
        cluster = running.enter_context(CitusCluster(programs))
        place = cluster.fresh()
        nodes = [node_of(server.slots) for server in check(place) if server.slots]
        stack = running.enter_context(RealStack(tmp_path, gateways=2, clouds=2, place=place))
        store = running.enter_context(Store(place))
        viewer = running.enter_context(LiveViewer(stack, stack.token()))
        sensors = [running.enter_context(stack.sensor_node(node)) for node in nodes]
        for node in nodes:
            wait_until(Flow(store, node).has_begun, "messages are stored")
        for away_s in (*[1.0] * _TIMES, 10.0):
            flows = measure(store, cluster.workers[0], nodes, away_s=away_s)
            log_flows(f"a worker for {away_s:g} s", flows)
            assert flows[1].pause_s < PAUSE_S, "the other worker's data flow on"
        for _ in range(_TIMES):
            log_flows("the coordinator for 1 s", measure(store, cluster, nodes, away_s=1.0))
        for sensor in sensors:
            assert sensor.stop() == 0
            assert "waiting=0" in sensor.output(), sensor.output()
        wait_until(lambda: not any(map(waiting, stack.spools)), "the spools are empty")
        require_each_once(store, viewer)


def waiting(spool: Path) -> int:
    ((number,),) = ask(spool, "SELECT count(*) FROM messages")
    return int(number)
