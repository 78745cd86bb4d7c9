"""Descriptions that the cloud lacks are posted, and messages that need them posted again."""

from __future__ import annotations

from typing import TYPE_CHECKING

import orjson
import pytest
from eskin_gateway.forward.forwarder import UnknownLayouts
from eskin_gateway.spool.batch import Batch, Description, SpoolMessage
from eskin_gateway.spool.spool import Spool
from eskin_gateway.upstream.cloud_client import CloudClient
from eskin_gateway.upstream.descriptions_client import DescriptionsClient
from eskin_gateway.upstream.ingest_client import IngestClient, ItemResult

from eskin.errors import CloudError
from eskin.identity import IdentityKind, client_context
from eskin.identity.identity import ROOT_FILE
from tests.unit.gateway.certificates import KnownNodes
from tests.unit.gateway.descriptions import KnownDescriptions
from tests.unit.gateway.forwarding import MESSAGES, MemoryCloud, Setup
from tests.unit.gateway.https_server import HttpsServer
from tests.unit.gateway.skins import SMALL

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator, Mapping, Sequence
    from pathlib import Path

    from tests.support.identities import Identities

WANT = SMALL.layout.content_hash
FRAME = b"a frame"


class Lacking(MemoryCloud):
    """A cloud that takes ``FRAME`` only from nodes whose layout was posted.

    Attributes:
        descriptions: Takes them.
        forgets: Whether it lacks them all the same.
    """

    def __init__(self) -> None:
        super().__init__()
        self.descriptions = KnownDescriptions()
        self.forgets = False

    def send(self, messages: Sequence[tuple[str, bytes]]) -> list[ItemResult]:
        lacks = ItemResult("unknown_layout", "post it", (WANT,))
        good = iter(super().send([each for each in messages if self._has(*each)]))
        return [next(good) if self._has(*each) else lacks for each in messages]

    def _has(self, node: str, body: bytes) -> bool:
        known = (node, WANT) in self.descriptions.posted and node not in self.descriptions.unknown
        return body != FRAME or (known and not self.forgets)


@pytest.fixture
def cloud() -> Lacking:
    return Lacking()


@pytest.fixture
def setup(tmp_path: Path, cloud: Lacking) -> Iterator[Setup]:
    made = Setup(tmp_path, cloud, cloud, descriptions=cloud.descriptions)
    made.spool.commit(Batch([SpoolMessage("n", 1, FRAME), SpoolMessage("m", 1, b"last")]))
    yield made
    made.spool.close()


def drain(setup: Setup) -> None:
    for _ in range(50):
        if not setup.forwarder.forward():
            return


def test_layout_is_posted_and_the_frame_again(setup: Setup, cloud: Lacking) -> None:
    drain(setup)
    assert cloud.descriptions.posted == [("n", WANT)]
    assert sorted(cloud.stored) == sorted([*MESSAGES, ("n", FRAME), ("m", b"last")])
    assert setup.spool.statistics.messages == 0
    assert setup.spool.dead_letters() == []
    assert setup.forwarder.fault is None


def test_frame_whose_description_is_rejected_is_a_dead_letter_and_delays_none(
    setup: Setup, cloud: Lacking
) -> None:
    cloud.descriptions.rejected.add(WANT)
    cloud.forgets = True
    drain(setup)
    (letter,) = setup.spool.dead_letters()
    assert (letter.node, letter.body) == ("n", FRAME)
    assert WANT.hex() in letter.reason
    assert setup.spool.statistics.messages == 0
    assert ("m", b"last") in cloud.stored
    assert setup.metrics.value("cloud_rejected_total") == 1


def test_frame_of_a_cloud_that_forgets_waits_and_holds_up_no_other_node(
    setup: Setup, cloud: Lacking
) -> None:
    cloud.forgets = True
    drain(setup)
    assert cloud.descriptions.posted == [("n", WANT)], "not in a loop"
    assert setup.spool.statistics.messages == 1
    assert ("m", b"last") in cloud.stored
    assert setup.spool.dead_letters() == []
    assert setup.forwarder.fault is not None


def test_layout_is_posted_again_after_a_minute() -> None:
    now, client = [0.0], KnownDescriptions()
    unknown = UnknownLayouts(client, lambda: now[0])
    for _ in range(3):
        unknown.post([("n", WANT), ("m", bytes([len(client.posted)]) * 32)])
    assert client.posted.count(("n", WANT)) == 1
    assert unknown.left_out() == ["n"]
    assert len(client.posted) > 2, "the other node's is posted"
    now[0] += 61.0
    assert unknown.left_out() == []
    assert unknown.fault is None
    unknown.post([("n", WANT)])
    assert client.posted.count(("n", WANT)) == 2


def test_node_that_the_cloud_does_not_know_is_registered_first(
    setup: Setup, cloud: Lacking
) -> None:
    cloud.descriptions.unknown.add("n")

    class Registering(KnownNodes):
        def register(self, nodes: Collection[str]) -> dict[str, str]:
            cloud.descriptions.unknown -= set(nodes)
            return super().register(nodes)

    setup.forwarder._unknown_nodes._certificates_client = Registering()
    drain(setup)
    assert ("n", FRAME) in cloud.stored
    assert setup.spool.statistics.messages == 0


@pytest.fixture
def described(tmp_path: Path) -> Iterator[Spool]:
    spool = Spool(tmp_path / "spool.db", capacity=10**7, max_dead_letters=10)
    names = zip(SMALL.hashes, SMALL.descriptions, strict=True)
    spool.commit(Batch(descriptions=[Description("n", name, body) for name, body in names]))
    yield spool
    spool.close()


class Answering:
    """An HTTPS server that gives one answer to all."""

    def __init__(self, identities: Identities, answer: object) -> None:
        server = identities.make(IdentityKind.SERVER, "server.cloud")
        self._server = HttpsServer(server, 0, self._respond, clients=True)
        self.asked: list[bytes] = []
        self._answer = answer
        self.client = CloudClient(
            [f"https://127.0.0.1:{self._server.server_address[1]}/api/v1/ingest"],
            headers=lambda: {"Content-Type": "application/cbor"},
            context=client_context(
                identities.gateway.directory / ROOT_FILE, identities.gateway
            ),
            timeout_s=30.0,
        )  # fmt: skip

    def _respond(
        self, path: str, headers: Mapping[str, str], body: bytes
    ) -> tuple[int, dict[str, str], bytes]:
        del path, headers
        self.asked.append(body)
        return 200, {"content-type": "application/json"}, orjson.dumps(self._answer)

    def close(self) -> None:
        self.client.close()
        self._server.close()


def test_lost_description_is_rejected_without_asking(
    described: Spool, identities: Identities
) -> None:
    cloud = Answering(identities, {"items": [{"result": "stored", "reason": None}]})
    client = DescriptionsClient(cloud.client, described)
    posted = client.post([("n", WANT), ("n", bytes(32)), ("m", WANT)])
    assert [each.result for each in posted.values()] == ["stored", "rejected", "rejected"]
    assert len(cloud.asked) == 1
    cloud.close()


BAD = {
    "short": {"items": []},
    "result": {"items": [{"result": "eaten", "reason": None}]},
    "shape": {"items": [["stored"]]},
    "none": [],
}


@pytest.mark.parametrize("fault", BAD)
def test_answer_that_makes_no_sense_is_an_error(
    described: Spool, identities: Identities, fault: str
) -> None:
    cloud = Answering(identities, BAD[fault])
    with pytest.raises(CloudError):
        DescriptionsClient(cloud.client, described).post([("n", WANT)])
    cloud.close()


@pytest.mark.parametrize("want", [None, [], ["xyz"], [5]])
def test_unknown_layout_without_hashes_is_an_error(identities: Identities, want: object) -> None:
    item = {"result": "unknown_layout", "reason": "post it", "want": want}
    cloud = Answering(identities, {"items": [item]})
    with pytest.raises(CloudError):
        IngestClient(cloud.client).send([("n", FRAME)])
    cloud.close()


def test_hashes_of_unknown_layouts_are_read(identities: Identities) -> None:
    item = {"result": "unknown_layout", "reason": "post it", "want": [WANT.hex()]}
    cloud = Answering(identities, {"items": [item]})
    (result,) = IngestClient(cloud.client).send([("n", FRAME)])
    assert (result.result, result.want) == ("unknown_layout", (WANT,))
    cloud.close()
