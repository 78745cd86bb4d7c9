"""A real broker, a stub cloud, and a gateway between them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from eskin_gateway.service import Gateway
from eskin_gateway.settings import (
    BrokerSection,
    CloudSection,
    CommandsSection,
    GatewaySettings,
    HttpSection,
    IdentitySection,
    NodesSection,
    SpoolSection,
)

from eskin.identity import IdentityKind
from tests.support.brokers import Mosquitto
from tests.support.processes import wait_until
from tests.unit.gateway.in_memory import Inside
from tests.unit.gateway.stub_cloud import StubCloud
from tests.unit.gateway.wire_node import Seal, WireNode

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from tests.support.identities import Identities


@pytest.fixture
def broker(tmp_path: Path, identities: Identities) -> Iterator[Mosquitto]:
    """Mosquitto, listening."""
    with Mosquitto(tmp_path / "broker", identities) as running:
        yield running


@pytest.fixture
def cloud(identities: Identities) -> Iterator[StubCloud]:
    """The stub cloud, listening; in the end no request may have been other than agreed."""
    with StubCloud(identities.make(IdentityKind.SERVER, "server.cloud")) as running:
        yield running
    assert running.faults == []


@pytest.fixture
def settings(
    tmp_path: Path, identities: Identities, broker: Mosquitto, cloud: StubCloud
) -> GatewaySettings:
    """Settings that put a gateway between the two."""
    return GatewaySettings(
        broker=BrokerSection(host="127.0.0.1", port=broker.gateway_port),
        identity=IdentitySection(
            directory=identities.gateway.directory, site=identities.site.directory
        ),
        cloud=CloudSection(url=cloud.url, retry_s=0.05, retry_max_s=0.2, timeout_s=60.0),
        # The longest: what arrives sooner did not wait for a timeout.
        commands=CommandsSection(wait_s=60.0),
        spool=SpoolSection(path=tmp_path / "spool.db"),
        http=HttpSection(port=0),
        nodes=NodesSection(silence_s=0.5),
    )


@pytest.fixture
def gateway(settings: GatewaySettings) -> Iterator[Gateway]:
    """A gateway, connected."""
    running = Gateway(settings)
    running.start()
    wait_until(lambda: running.broker.connected, "the gateway is connected")
    yield running
    running.stop()


@pytest.fixture
def inside(tmp_path: Path, identities: Identities) -> Iterator[Inside]:
    """A gateway's inside, without a network."""
    made = Inside(tmp_path, identities)
    yield made
    made.spool.close()


@pytest.fixture
def seal(identities: Identities) -> Seal:
    """Seals as the node ``fingertip`` does."""
    return Seal(identities.node, identities.site)


@pytest.fixture
def node(identities: Identities, broker: Mosquitto) -> Iterator[WireNode]:
    """The node ``fingertip``, connected."""
    with WireNode(identities.node, identities.site, broker.node_port) as running:
        yield running
