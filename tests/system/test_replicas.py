"""Two clouds on one PostgreSQL server: gateways and people come to either, and see the same."""

from __future__ import annotations

import threading
from contextlib import ExitStack
from typing import TYPE_CHECKING

import pytest

from tests.support.processes import wait_until
from tests.unit.cloud.clouds import batch
from tests.unit.cloud.messages import CHANNEL, NODE, peak, stretch
from tests.unit.cloud.service import Service

if TYPE_CHECKING:
    from collections.abc import Iterator

    from tests.support.identities import Identities
    from tests.support.postgresql import Cluster

pytestmark = pytest.mark.nightly


@pytest.fixture(scope="module")
def replicas(
    tmp_path_factory: pytest.TempPathFactory, identities: Identities, cluster: Cluster
) -> Iterator[list[Service]]:
    """Two running clouds, started at once on an empty database."""
    folder = tmp_path_factory.mktemp("replicas")
    place = cluster.fresh(empty=True)
    made = [Service(folder / name, identities, place=place) for name in ("one", "two")]
    with ExitStack() as stack:
        for service in made:
            service.begin()
            stack.callback(service.stop)
        for service in made:
            service.wait_until_ready()
        yield made


class Listener(threading.Thread):
    """Hears a cloud's live stream until it ends."""

    def __init__(self, service: Service, token: str) -> None:
        super().__init__()
        self._service = service
        self._token = token
        self.lines: list[str] = []

    def run(self) -> None:
        with (
            self._service.people(self._token) as client,
            client.stream("GET", "/api/v1/live") as answer,
        ):
            self.lines += answer.iter_lines()

    @property
    def cursors(self) -> list[str]:
        """Cursors of the frames and peaks that were stated, in their order."""
        stated = "\n".join(self.lines).split("\n\n")
        wanted = [each for each in stated if "event: frame" in each or "event: peak" in each]
        return [line[4:] for each in wanted for line in each.split("\n") if line[:4] == "id: "]


def test_replicas_store_once_and_both_tell_all(replicas: list[Service]) -> None:
    one, two = replicas
    token = one.token()
    listeners = [Listener(service, token) for service in replicas]
    for listener in listeners:
        listener.start()
    wait_until(lambda: all(": connected" in heard.lines for heard in listeners), "both listen")
    for number in range(0, 20, 2):
        first, second = (one, two) if number % 4 else (two, one)
        said = batch(stretch(number), peak(number + 1))
        answers = [service.ingest(said).json()["items"] for service in (first, second)]
        results = [[item["result"] for item in items] for items in answers]
        assert results == [["stored"] * 2, ["duplicate"] * 2]
    wait_until(lambda: all(len(heard.cursors) >= 20 for heard in listeners), "both stated all")
    # Where the machine is slow, one that falls silent is an event between them.
    everything = listeners[0].cursors
    assert listeners[1].cursors == everything
    assert len(everything) == len(set(everything)) == 20
    for service in replicas:
        with service.people(token) as client:
            assert len(client.get(f"/api/v1/series/{NODE}/{CHANNEL}").json()["lo"]) == 10
            assert len(client.get("/api/v1/events?kind=peak").json()["items"]) == 10
    for service in replicas:
        assert service.stop() == 0
    for listener in listeners:
        listener.join(120)
        assert not listener.is_alive()
