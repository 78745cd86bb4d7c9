"""A compromised broker can neither read, forge, replay nor redirect; what it drops comes again."""

from __future__ import annotations

from contextlib import ExitStack
from typing import TYPE_CHECKING

import pytest
from eskin_gateway.service import Gateway
from eskin_gateway.settings import (
    BrokerSection,
    CloudSection,
    GatewaySettings,
    HttpSection,
    IdentitySection,
    SpoolSection,
)
from eskin_sensor_node.link.publisher import Publisher
from eskin_sensor_node.settings import BrokerSection as NodeBroker
from eskin_sensor_node.settings import IdentitySection as NodeIdentity

from eskin.identity import IdentityKind
from eskin.identity.identity import CHAIN_FILE
from eskin.wire.messages.cbor_map import load
from eskin.wire.messages.header import Kind, read_position
from eskin.wire.topics import NODES
from tests.support.identities import Identities
from tests.support.processes import wait_until
from tests.system.hostile import NAMES, Hostile
from tests.unit.gateway.stub_cloud import StubCloud
from tests.unit.sensor_node.designs import Bench

if TYPE_CHECKING:
    from pathlib import Path


def gateway(folder: Path, own: Identities, port: int, url: str) -> Gateway:
    return Gateway(
        GatewaySettings(
            broker=BrokerSection(host="127.0.0.1", port=port),
            identity=IdentitySection(directory=own.gateway.directory, site=own.site.directory),
            cloud=CloudSection(url=url, retry_s=0.05, retry_max_s=0.2, timeout_s=120.0),
            spool=SpoolSection(path=folder / "spool.db"),
            http=HttpSection(port=0),
        )
    )


def publisher(own: Identities, name: str, bench: Bench, port: int) -> Publisher:
    return Publisher(
        bench.outbox,
        radio=bench.radio(),
        record_status=bench.node.record_status,
        broker=NodeBroker(
            port=port, resend_s=0.3, status_s=0.5, drain_s=0.0, window=20, silence_s=5.0
        ),
        identity=NodeIdentity(
            directory=own.make(IdentityKind.NODE, name).directory,
            site=own.site.directory / CHAIN_FILE,
        ),
    )


@pytest.mark.timeout(900)
def test_hostile_broker_can_neither_read_nor_forge_nor_replay_nor_redirect(
    tmp_path: Path,
) -> None:
    own = Identities(tmp_path / "pki")
    broker = own.make(IdentityKind.SERVER, "server.broker")
    with ExitStack() as stack:
        cloud = stack.enter_context(StubCloud(own.make(IdentityKind.SERVER, "server.cloud")))
        hostile = stack.enter_context(Hostile(own, broker))
        running = gateway(tmp_path, own, hostile.port, cloud.url)
        running.start()
        stack.callback(running.stop)
        said: dict[str, list[bytes]] = {}
        benches = {name: Bench(tmp_path / name) for name in NAMES}
        for name, bench in benches.items():
            stack.callback(bench.close)
            bench.run_to(5.0)
            said[name] = list(bench.bodies())
            talking = publisher(own, name, bench, hostile.port)
            talking.start()
            stack.callback(talking.stop)
        malice = hostile.malice
        wait_until(lambda: malice.done > 400, "it has tried everything", seconds=200)
        for name, bench in benches.items():
            forgotten = set(said[name]) - set(bench.bodies())
            wait_until(
                lambda n=name, f=forgotten: f <= kept(cloud, n),  # type: ignore[misc]
                "whatever it said, a node forgets only what is stored",
            )
        malice.evil = False
        for bench in benches.values():
            wait_until(lambda b=bench: b.outbox.messages == 0, "empty", seconds=150)  # type: ignore[misc]
        wait_until(lambda: running.spool.statistics.messages == 0, "the cloud has all")
        for name in NAMES:
            require_exactly(said[name], [body for node, body in cloud.stored if node == name])
        assert {node for node, _ in cloud.stored} == set(NAMES)
        assert cloud.duplicates == 0
        passed = b"".join(data for topic, data in malice.seen if topic.startswith(NODES))
        assert not [body for bodies in said.values() for body in bodies if body in passed]
        reasons = ("forged", "malformed", "wrong_recipient", "misaddressed")
        refused = [
            running.metrics.value("messages_rejected_total", reason=reason) for reason in reasons
        ]
        assert refused[0] > 0
        assert refused[1] > 0


def kept(cloud: StubCloud, name: str) -> set[bytes]:
    return {body for node, body in list(cloud.stored) if node == name}


def require_exactly(said: list[bytes], stored: list[bytes]) -> None:
    """All that was said is stored once; beyond it only later statuses, each position once."""
    assert [stored.count(body) for body in said] == [1] * len(said)
    messages = [load(body) for body in stored]
    positions = [read_position(message) for message in messages]
    assert len(set(positions)) == len(positions)
    later = [m for m, body in zip(messages, stored, strict=True) if body not in set(said)]
    assert {message.integer(1, 0, 255) for message in later} <= {Kind.STATUS}
