"""Who is not the broker is given nothing by a node, which says why, and keeps its data."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

import paho.mqtt.client as mqtt
import pytest

from eskin.identity import IdentityKind
from tests.support.impostor import GUISES, Impostor, guise, is_tls
from tests.support.processes import wait_until
from tests.unit.sensor_node.designs import waiting
from tests.unit.sensor_node.peer import Peer

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from tests.support.brokers import Mosquitto
    from tests.support.identities import Identities
    from tests.unit.sensor_node.designs import Bench


@pytest.fixture(autouse=True)
def soon(monkeypatch: pytest.MonkeyPatch) -> None:
    """A node connects again after a tenth of a second, instead of 1 to 8 s."""
    delay = mqtt.Client.reconnect_delay_set
    monkeypatch.setattr(mqtt.Client, "reconnect_delay_set", lambda own, **_: delay(own, 0.1, 0.1))  # type: ignore[arg-type]


@pytest.mark.parametrize("name", GUISES)
def test_node_sends_nothing_to_an_impostor(
    name: str,
    bench: Bench,
    broker: Mosquitto,
    identities: Identities,
    publishing: Callable[..., Any],
    tmp_path: Path,
    caplog: pytest.LogCaptureFixture,
) -> None:
    broker.stop()
    bench.run_to(1.0)
    kept = {record.position for record in waiting(bench.flash)}
    with publishing():
        with Impostor(broker.node_port, guise(name, identities, tmp_path)) as impostor:
            wait_until(lambda: len(impostor.visits) >= 2, "it tries again")
        assert impostor.confided == b""
        for visit in impostor.visits:
            assert is_tls(visit.after) if name == "plaintext" else visit.after == b""
        assert re.search(rf"broker unreachable.*reason=.*{GUISES[name]}", caplog.text)
        assert {record.position for record in waiting(bench.flash)} == kept
        broker.begin()
        with Peer(identities, broker.gateway_port) as peer:
            wait_until(lambda: bench.outbox.messages == 0, "flash is empty")
            assert {(p.boot, p.sequence) for p in peer.messages} >= kept


def test_messages_to_the_right_certificate_are_recorded(
    bench: Bench, broker: Mosquitto, identities: Identities, publishing: Callable[..., Any]
) -> None:
    broker.stop()
    right = identities.make(IdentityKind.SERVER, "server.broker")
    with publishing(), Impostor(bench.settings.broker.port, right) as impostor:
        wait_until(lambda: b"MQTT" in impostor.confided, "it is heard")
