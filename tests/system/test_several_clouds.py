"""Three clouds on one store, two gateways and a fleet: the same on PostgreSQL and on Citus."""

from __future__ import annotations

import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from typing import TYPE_CHECKING, Final

import cbor2
import pytest
from eskin_cloud.store import Store
from eskin_cloud.store.schema.frame_tables import frames
from sqlalchemy import select

from eskin.identity import numbered
from eskin.wire.slot import slot_of
from tests.support.files import ask
from tests.support.fleets import RunningFleet, enrol
from tests.support.live_viewers import LiveViewer, count_stored, require_each_once
from tests.support.processes import wait_until
from tests.support.stacks import RealStack

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from sqlalchemy import URL

LIMIT_S: Final = 10.0
_NODES: Final = 6
_MORE: Final = 60
"""Messages by which data are seen to flow on."""


@pytest.fixture(scope="module")
def stack(
    tmp_path_factory: pytest.TempPathFactory, make_place: Callable[[], URL]
) -> Iterator[RealStack]:
    """Three clouds, started at once on an empty store; each gateway begins with another."""
    folder = tmp_path_factory.mktemp("clouds")
    with RealStack(folder, gateways=2, clouds=3, place=make_place()) as running:
        yield running


def waiting(spool: Path) -> int:
    """How many messages a gateway has not brought to a cloud."""
    ((number,),) = ask(spool, "SELECT count(*) FROM messages")
    return int(number)


@pytest.mark.nightly
def test_kill_of_a_cloud_loses_and_doubles_nothing(stack: RealStack) -> None:
    """All viewers, of whichever cloud, see each sample once; one of them goes on at another."""
    names = numbered("skin", _NODES)
    assert len(set(map(slot_of, names))) > 1
    enrol(stack.identities, names)
    token = stack.token()
    port = stack.broker.node_port
    fleet = RunningFleet(stack.folder / "fleet", stack.pki, port=port, count=_NODES)
    with ExitStack() as reading:
        store = reading.enter_context(Store(stack.place))
        viewers = [
            reading.enter_context(LiveViewer(stack, token, cloud=number))
            for number in range(len(stack.clouds))
        ]
        wait_until(lambda: all(each.connected for each in viewers), "all viewers are connected")
        with fleet:
            wait_until(lambda: all(each.samples for each in viewers), "all viewers see frames")
            viewers[0].may_resume.clear()
            stack.clouds[0].kill()
            killed, before = time.monotonic(), count_stored(store)
            shown = [viewer.samples for viewer in viewers]
            wait_until(lambda: count_stored(store) > before + _MORE, "messages are stored again")
            assert time.monotonic() - killed < LIMIT_S
            viewers[0].may_resume.set()  # it has missed something by now
            wait_until(
                lambda: all(each.samples > seen for each, seen in zip(viewers, shown, strict=True)),
                "all viewers go on",
            )
            stack.start_cloud(0)
            fleet.stop()
        wait_until(lambda: not any(map(waiting, stack.spools)), "the spools are empty")
        require_each_once(store, *viewers)
        assert [viewer.breaks > 0 for viewer in viewers] == [True, False, False]


@pytest.mark.nightly
def test_message_is_a_duplicate_at_each_cloud(stack: RealStack) -> None:
    """All that is stored is brought again, to all clouds at once."""
    with Store(stack.place) as store, store.read() as connection:
        stored = connection.execute(select(frames.c.node, frames.c.data)).all()
    assert len({node for node, _ in stored}) == _NODES
    body = cbor2.dumps([[node, bytes(data)] for node, data in stored])

    def bring(cloud: int) -> set[str]:
        with stack.gateway_client(cloud) as client:
            answer = client.post("/ingest", content=body)
        return {item["result"] for item in answer.json()["items"]}

    with ThreadPoolExecutor(3) as pool:
        assert list(pool.map(bring, range(3))) == [{"duplicate"}] * 3
    with Store(stack.place) as store, store.read() as connection:
        assert len(connection.execute(select(frames.c.cursor)).all()) == len(stored)
