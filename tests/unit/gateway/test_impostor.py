"""A gateway sends nothing to an impostor of the broker, reports it, and keeps its spool."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import httpx
import pytest

from eskin.wire.topics import Stream
from tests.support.impostor import GUISES, Impostor, guise, is_tls
from tests.support.processes import wait_until
from tests.unit.gateway.messages import frame, status
from tests.unit.gateway.wire_node import WireNode

if TYPE_CHECKING:
    from pathlib import Path

    from eskin_gateway.service import Gateway

    from tests.support.brokers import Mosquitto
    from tests.support.identities import Identities
    from tests.unit.gateway.stub_cloud import StubCloud


@pytest.mark.parametrize("name", GUISES)
def test_gateway_sends_nothing_to_an_impostor(
    name: str,
    gateway: Gateway,
    broker: Mosquitto,
    cloud: StubCloud,
    identities: Identities,
    tmp_path: Path,
) -> None:
    cloud.end()
    with WireNode(identities.node, identities.site, broker.node_port) as node:
        node.say(Stream.STATUS, status(0))
        node.wait_for((1, 0))
    broker.stop()
    with Impostor(broker.gateway_port, guise(name, identities, tmp_path)) as impostor:
        wait_until(lambda: len(impostor.visits) >= 2, "it tries again")
        url = f"http://127.0.0.1:{gateway.health_server.port}/healthz"
        report = httpx.get(url, trust_env=False, timeout=60).json()
        assert any(re.match(rf"broker: .*{GUISES[name]}", why) for why in report["reasons"])
        assert report["broker"] == {"connected": False}
        assert gateway.spool.statistics.messages == 1
        cloud.begin()
        wait_until(lambda: len(cloud.stored) == 1, "what lay in the spool is stored")
    assert impostor.confided == b""
    for visit in impostor.visits:
        assert is_tls(visit.after) if name == "plaintext" else visit.after == b""
    broker.begin()
    wait_until(lambda: gateway.broker.connected, "the gateway is connected again")
    with WireNode(identities.node, identities.site, broker.node_port) as node:
        node.say(Stream.FRAMES, frame(1))
        node.wait_for((1, 1))
    wait_until(lambda: len(cloud.stored) == 2, "what came later is stored, too")
