"""Nodes that the cloud does not know are registered or left out."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from eskin_gateway.forward.forwarder import UnknownNodes
from eskin_gateway.spool.batch import Batch, NodeCertificate, SpoolMessage
from eskin_gateway.spool.node_state import NodeState
from eskin_gateway.spool.spool import Spool
from eskin_gateway.upstream.certificates_client import CertificatesClient
from eskin_gateway.upstream.cloud_client import CloudClient
from eskin_gateway.upstream.ingest_client import ItemResult

from eskin.identity import IdentityKind, client_context, der, thumbprint
from tests.unit.gateway.certificates import KnownNodes
from tests.unit.gateway.forwarding import MemoryCloud, Setup

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from tests.support.identities import Identities


class Forgetful(MemoryCloud):
    """A cloud that stores nothing of nodes that were not registered."""

    def __init__(self) -> None:
        super().__init__()
        self.certificates = KnownNodes()

    def send(self, messages: Sequence[tuple[str, bytes]]) -> list[ItemResult]:
        known = set(self.certificates.registered) - self.certificates.rejected.keys()
        strange = ItemResult("unknown_node", "present it")
        good = iter(super().send([each for each in messages if each[0] in known]))
        return [next(good) if node in known else strange for node, _ in messages]


@pytest.fixture
def cloud() -> Forgetful:
    return Forgetful()


@pytest.fixture
def setup(tmp_path: Path, cloud: Forgetful) -> Setup:
    made = Setup(tmp_path, cloud, cloud)
    made.certificates.registered = cloud.certificates.registered
    made.certificates.rejected = cloud.certificates.rejected
    return made


def drain(setup: Setup) -> None:
    for _ in range(50):
        if not setup.forwarder.forward():
            return


def test_unknown_node_is_registered_and_its_messages_resent(setup: Setup, cloud: Forgetful) -> None:
    drain(setup)
    assert [body for _, body in cloud.stored] == [bytes([number]) for number in range(10)]
    assert cloud.certificates.registered == ["n"]
    assert setup.spool.statistics.messages == 0
    assert setup.spool.dead_letters() == []


def test_rejected_node_loses_nothing_and_blocks_no_others(setup: Setup, cloud: Forgetful) -> None:
    cloud.certificates.rejected["n"] = "of another site"
    setup.spool.commit(Batch([SpoolMessage("m", 1, b"x"), SpoolMessage("m", 1, b"y")]))
    drain(setup)
    assert cloud.stored == [("m", b"x"), ("m", b"y")]
    assert setup.spool.statistics.messages == 10
    assert setup.spool.dead_letters() == []
    assert "of another site" in str(setup.forwarder.fault)


def test_rejected_node_is_retried_later() -> None:
    now, way = [0.0], KnownNodes()
    unknown = UnknownNodes(way, lambda: now[0])
    way.rejected["n"] = "no"
    unknown.register({"n"})
    assert unknown.rejected() == ["n"]
    now[0] += 61.0
    assert unknown.rejected() == []
    assert unknown.fault is None
    way.rejected.clear()
    unknown.register({"n"})
    assert unknown.rejected() == []
    unknown.register({"n"})  # registered in vain: not retried in a loop
    assert unknown.rejected() == ["n"]


def test_latest_certificate_of_a_node_is_kept_after_it_expired(
    tmp_path: Path, identities: Identities
) -> None:
    own = identities.make(IdentityKind.NODE, "asleep")
    leaf, issuer = (der(part) for part in own.chain)
    state = NodeState(thumbprint=own.thumbprint)
    node_certificates = [
        NodeCertificate(own.thumbprint, 1, leaf, issuer),
        NodeCertificate(b"other", 1, leaf, issuer),
    ]
    path = tmp_path / "spool.db"
    for _ in range(2):
        spool = Spool(path, capacity=10**6, max_dead_letters=10)
        spool.commit(Batch(nodes={"asleep": state}, certificates=node_certificates))
        spool.close()
        node_certificates = []
    spool = Spool(path, capacity=10**6, max_dead_letters=10)
    assert spool.certificate(thumbprint(own.certificate)) is not None
    assert spool.certificate(b"other") is None
    spool.close()


def test_node_without_a_state_has_no_certificate(tmp_path: Path, identities: Identities) -> None:
    spool = Spool(tmp_path / "spool.db", capacity=10**6, max_dead_letters=10)
    context = client_context(identities.gateway.directory / "root.pem")
    client = CloudClient(
        ["https://localhost:1/api/v1/ingest"], headers=dict, context=context, timeout_s=1
    )
    way = CertificatesClient(client, spool)
    assert not way.has("unknown")
    assert set(way.register(["unknown"])) == {"unknown"}
    client.close()
    spool.close()
