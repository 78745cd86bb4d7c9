"""A gateway that knows several clouds shares its nodes out, and goes on when a cloud fails."""

from __future__ import annotations

import socket
from collections import Counter
from contextlib import ExitStack
from time import perf_counter
from typing import TYPE_CHECKING

import pytest
from eskin_gateway.settings import CloudSection
from eskin_gateway.spool.batch import Batch, SpoolMessage
from eskin_gateway.upstream.cloud_client import CloudClient
from eskin_gateway.upstream.ingest_client import IngestClient
from pydantic import ValidationError

from eskin.errors import CloudError
from eskin.identity import IdentityKind, client_context
from eskin.identity.identity import ROOT_FILE
from eskin.wire.slot import SLOTS
from tests.support.processes import free_port
from tests.unit.gateway.forwarding import MESSAGES, Setup
from tests.unit.gateway.https_server import HttpsServer
from tests.unit.gateway.stub_cloud import StubCloud

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from pathlib import Path

    from tests.support.identities import Identities


class Cloud:
    """A cloud that answers with its name, and may be ended and started again.

    Attributes:
        status: Of its answers.
        asked: The bodies that it was sent.
        port: Where it listens.
    """

    def __init__(self, name: bytes, identities: Identities) -> None:
        self.status = 200
        self.asked: list[bytes] = []
        self._name = name
        self._identity = identities.make(IdentityKind.SERVER, "server.cloud")
        self.port = free_port()
        self._server: HttpsServer | None = None
        self.start()

    @property
    def url(self) -> str:
        return f"https://127.0.0.1:{self.port}/api/v1/ingest"

    def start(self) -> None:
        self._server = HttpsServer(self._identity, self.port, self)

    def end(self) -> None:
        if self._server is not None:
            self._server.close()
        self._server = None

    def __call__(
        self, _path: str, _headers: Mapping[str, str], body: bytes, /
    ) -> tuple[int, dict[str, str], bytes]:
        self.asked.append(body)
        return self.status, {}, self._name


@pytest.fixture
def clouds(identities: Identities) -> Iterator[list[Cloud]]:
    made = [Cloud(name, identities) for name in (b"one", b"two", b"three")]
    yield made
    for each in made:
        each.end()


class Clock:
    """Monotonic seconds that the test sets."""

    def __init__(self) -> None:
        self.now = 1000.0

    def __call__(self) -> float:
        return self.now


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def client(identities: Identities, clouds: list[Cloud], clock: Clock) -> Iterator[CloudClient]:
    made = make_client(identities, [each.url for each in clouds], clock)
    yield made
    made.close()


def make_client(identities: Identities, urls: list[str], clock: Clock) -> CloudClient:
    context = client_context(identities.gateway.directory / ROOT_FILE)
    return CloudClient(urls, headers=dict, context=context, timeout_s=5.0, clock=clock)


def homes(client: CloudClient) -> list[bytes]:
    """The cloud that answers for each fourth slot."""
    return [client.post("ingest", b"", slot=slot) for slot in range(0, SLOTS, 4)]


def test_request_that_finds_no_cloud_goes_to_the_next_as_do_later_ones(
    clouds: list[Cloud], client: CloudClient
) -> None:
    one, two, three = clouds
    assert client.post("ingest", b"1") == b"one"
    one.end()
    assert [client.post("ingest", body) for body in (b"2", b"3")] == [b"two"] * 2
    assert client.url == two.url
    two.end()
    assert client.post("ingest", b"4") == b"three"
    three.end()
    one.start()
    assert client.post("ingest", b"5") == b"one"
    assert [each.asked for each in clouds] == [[b"1", b"5"], [b"2", b"3"], [b"4"]]


@pytest.mark.parametrize("status", [502, 503, 504])
def test_cloud_that_cannot_store_is_left(
    clouds: list[Cloud], client: CloudClient, status: int
) -> None:
    clouds[0].status = status
    assert client.post("ingest", b"1") == b"two"
    clouds[0].status = 200
    assert client.post("ingest", b"2") == b"two"


@pytest.mark.parametrize("status", [401, 403, 413, 422, 429, 500])
def test_request_that_a_cloud_rejects_goes_to_no_other(
    clouds: list[Cloud], client: CloudClient, status: int
) -> None:
    clouds[0].status = status
    with pytest.raises(CloudError) as raised:
        client.post("ingest", b"1")
    assert raised.value.status == status
    assert [each.asked for each in clouds] == [[b"1"], [], []]


def test_where_all_fail_the_last_failure_counts_and_each_was_asked_once(
    clouds: list[Cloud], client: CloudClient
) -> None:
    clouds[0].end()
    clouds[1].status = 503
    clouds[2].status = 502
    with pytest.raises(CloudError) as raised:
        client.post("ingest", b"1")
    assert raised.value.status == 502
    assert [each.asked for each in clouds] == [[], [b"1"], [b"1"]]
    clouds[0].start()
    assert client.post("ingest", b"2") == b"one"


def test_each_cloud_has_as_many_slots_and_each_gateway_the_same_ones(
    identities: Identities, clouds: list[Cloud], client: CloudClient, clock: Clock
) -> None:
    urls = [each.url for each in clouds]
    other = make_client(identities, [urls[2], urls[0], urls[1]], clock)
    assert homes(other) == homes(client)
    assert sorted(Counter(homes(client)).values()) == [5, 5, 6]
    # What is of no slot goes to the cloud that the gateway's settings name first.
    assert (client.post("nodes", b""), other.post("nodes", b"")) == (b"one", b"three")
    other.close()


@pytest.mark.parametrize("fault", ["ended", "busy"])
def test_slots_of_a_cloud_that_fails_go_to_the_next_until_it_is_back(
    clouds: list[Cloud], client: CloudClient, clock: Clock, fault: str
) -> None:
    before = homes(client)
    two = clouds[1]
    two.status = 503
    if fault == "ended":
        two.end()
    asked = len(two.asked)
    without = homes(client)
    assert len(two.asked) <= asked + 1, "one that failed is left out"
    kept = [after for had, after in zip(before, without, strict=True) if had != b"two"]
    assert kept == [had for had in before if had != b"two"]
    assert set(without) == {b"one", b"three"}
    two.status = 200
    if fault == "ended":
        two.start()
    clock.now += 4.0
    assert homes(client) == without
    clock.now += 2.0
    assert homes(client) == before


def test_cloud_that_fails_on_is_tried_ever_more_rarely(
    clouds: list[Cloud], client: CloudClient, clock: Clock
) -> None:
    two = clouds[1]
    slot = 4 * homes(client).index(b"two")
    two.asked.clear()
    two.status = 503
    for _ in range(63):
        client.post("ingest", b"", slot=slot)
        clock.now += 10.0
    assert len(two.asked) == 8  # at 0, 10, 20, 40, 80, 160, 320 and 620 s


def test_cloud_that_hangs_holds_up_what_is_for_others_ever_less(
    clouds: list[Cloud], client: CloudClient, clock: Clock
) -> None:
    slot = 4 * homes(client).index(b"two")
    two = clouds[1]
    two.end()
    with socket.create_server(("127.0.0.1", two.port)):  # it accepts, and says nothing
        took = []
        for _ in range(3):
            begun = perf_counter()
            assert client.post("ingest", b"", slot=slot) != b"two"
            assert client.post("ingest", b"", slot=slot) != b"two"
            took.append(perf_counter() - begun)
            clock.now += 25.0
        assert max(took[1:]) < took[0] / 2
    two.start()
    clock.now += 300.0
    assert client.post("ingest", b"", slot=slot) == b"two"


def test_messages_of_a_node_stay_together_and_in_order_whatever_cloud_fails(
    tmp_path: Path, identities: Identities, clock: Clock
) -> None:
    identity = identities.make(IdentityKind.SERVER, "server.cloud")
    with ExitStack() as exits:
        stubs = [exits.enter_context(StubCloud(identity)) for _ in range(3)]
        share_out_and_fail(tmp_path, identities, clock, stubs)


def share_out_and_fail(
    tmp_path: Path, identities: Identities, clock: Clock, stubs: list[StubCloud]
) -> None:
    client = CloudClient(
        [stub.url for stub in stubs],
        headers=lambda: {"Content-Type": "application/cbor"},
        context=client_context(identities.gateway.directory / ROOT_FILE, identities.gateway),
        timeout_s=5.0,
        clock=clock,
    )
    setup = Setup(tmp_path, IngestClient(client), stubs[0], most=100)
    said = [(f"node-{k % 17}", b"%d" % k) for k in range(340)]
    setup.spool.commit(Batch([SpoolMessage(node, 1, body) for node, body in said]))
    assert setup.forwarder.forward() == 100
    assert all(stub.requests == 1 for stub in stubs)
    before = [len(stub.stored) for stub in stubs]
    stubs[0].end()
    while setup.forwarder.forward():
        pass
    assert setup.spool.statistics.messages == 0
    found = [each for stub in stubs for each in stub.stored]
    assert sorted(found) == sorted([*MESSAGES, *said])
    for stub in stubs:
        for node in {node for node, _ in stub.stored}:
            numbers = [int(body) for each, body in stub.stored if each == node != "n"]
            assert numbers == sorted(numbers)
    after = [len(stub.stored) for stub in stubs]
    assert after[0] == before[0]
    assert all(now > then for now, then in zip(after[1:], before[1:], strict=True))
    assert not any(stub.faults for stub in stubs)
    setup.spool.close()
    client.close()


def test_fallbacks_are_urls_of_clouds() -> None:
    with pytest.raises(ValidationError):
        CloudSection(fallbacks=["http://plain.example/api/v1/ingest"])
    named = CloudSection(fallbacks=["https://two.example:8443/api/v1/ingest"])
    assert named.fallbacks == ["https://two.example:8443/api/v1/ingest"]
