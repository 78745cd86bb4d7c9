"""A gateway that knows several clouds goes on with the next when one fails."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from eskin_gateway.settings import CloudSection
from eskin_gateway.upstream.cloud_client import CloudClient
from pydantic import ValidationError

from eskin.errors import CloudError
from eskin.identity import IdentityKind, client_context
from eskin.identity.identity import ROOT_FILE
from tests.support.processes import free_port
from tests.unit.gateway.https_server import HttpsServer

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from tests.support.identities import Identities


class Cloud:
    """A cloud that answers with its name, and may be ended and started again.

    Attributes:
        status: Of its answers.
        asked: The bodies that it was sent.
    """

    def __init__(self, name: bytes, identities: Identities) -> None:
        self.status = 200
        self.asked: list[bytes] = []
        self._name = name
        self._identity = identities.make(IdentityKind.SERVER, "server.cloud")
        self._port = free_port()
        self._server: HttpsServer | None = None
        self.start()

    @property
    def url(self) -> str:
        return f"https://127.0.0.1:{self._port}/api/v1/ingest"

    def start(self) -> None:
        self._server = HttpsServer(self._identity, self._port, self)

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


@pytest.fixture
def client(identities: Identities, clouds: list[Cloud]) -> Iterator[CloudClient]:
    context = client_context(identities.gateway.directory / ROOT_FILE)
    made = CloudClient([each.url for each in clouds], headers=dict, context=context, timeout_s=5.0)
    yield made
    made.close()


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


def test_fallbacks_are_urls_of_clouds() -> None:
    with pytest.raises(ValidationError):
        CloudSection(fallbacks=["http://plain.example/api/v1/ingest"])
    named = CloudSection(fallbacks=["https://two.example:8443/api/v1/ingest"])
    assert named.fallbacks == ["https://two.example:8443/api/v1/ingest"]
