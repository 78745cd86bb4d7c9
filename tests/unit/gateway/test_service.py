"""The gateway as a process: start, health, metrics and end."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

import httpx
import pytest

from eskin.errors import SpoolError
from eskin.wire.topics import Stream
from tests.support.processes import Running, free_port, wait_until
from tests.unit.gateway.messages import frame, status
from tests.unit.gateway.wire_node import WireNode

if TYPE_CHECKING:
    from pathlib import Path

    from eskin_gateway.service import Gateway
    from eskin_gateway.settings import GatewaySettings

    from tests.support.brokers import Mosquitto
    from tests.support.identities import Identities
    from tests.unit.gateway.stub_cloud import StubCloud

_PROGRAM = """
import logging, sys
from pathlib import Path
from eskin_gateway.service import run
from eskin_gateway.settings import GatewaySettings
logging.basicConfig(level="INFO")
run(GatewaySettings.load(Path(sys.argv[1])))
"""


def healthz(gateway: Gateway) -> httpx.Response:
    return ask(gateway, "/healthz")


def ask(gateway: Gateway, path: str) -> httpx.Response:
    url = f"http://127.0.0.1:{gateway.health_server.port}{path}"
    return httpx.get(url, trust_env=False, timeout=60)


def test_healthy_gateway_says_so(gateway: Gateway, node: WireNode) -> None:
    node.say(Stream.STATUS, status(0))
    node.wait_for((1, 0))
    wait_until(lambda: gateway.spool.statistics.messages == 0, "the spool is empty")
    answer = healthz(gateway)
    report = answer.json()
    assert answer.status_code == 200
    assert (report["status"], report["reasons"]) == ("ok", [])
    assert report["broker"] == {"connected": True}
    assert report["cloud"] == {"reachable": True}
    assert report["spool"]["messages"] == 0


def test_gateway_without_broker_or_cloud_says_why(
    gateway: Gateway, node: WireNode, broker: Mosquitto, cloud: StubCloud
) -> None:
    cloud.end()
    node.say(Stream.STATUS, status(0))
    node.wait_for((1, 0))
    wait_until(lambda: gateway.forwarder.reachable is False, "it noticed the cloud")
    wait_until(lambda: gateway.command_poller.fault is not None, "no commands can be fetched")
    broker.stop()
    wait_until(lambda: not gateway.broker.connected, "it noticed the broker")
    answer = healthz(gateway)
    report = answer.json()
    assert answer.status_code == 503
    parts = [reason.partition(":")[0] for reason in report["reasons"]]
    assert parts == ["broker", "cloud", "commands"]
    assert report["spool"]["messages"] == 1
    assert 0.0 <= report["spool"]["oldest_age_s"] < 600.0


def test_unreadable_spool_is_a_reason_and_hides_no_metric(
    gateway: Gateway, monkeypatch: pytest.MonkeyPatch
) -> None:
    def unreadable() -> None:
        raise SpoolError("spool.sqlite: it cannot be read: disk I/O error")

    monkeypatch.setattr(gateway.spool, "oldest", unreadable)
    answer = healthz(gateway)
    assert answer.status_code == 503
    assert "spool: spool.sqlite: it cannot be read: disk I/O error" in answer.json()["reasons"]
    assert answer.json()["spool"]["oldest_age_s"] is None
    figures = ask(gateway, "/metrics").text.splitlines()
    assert "eskin_gateway_spool_oldest_seconds NaN" in figures
    assert any(line.startswith("eskin_gateway_spool_bytes ") for line in figures)
    monkeypatch.undo()
    wait_until(lambda: healthz(gateway).status_code == 200, "it is well again")


def test_metrics_count_what_happened(gateway: Gateway, node: WireNode) -> None:
    node.say(Stream.STATUS, status(0))
    node.say(Stream.FRAMES, frame(1))
    node.publish(Stream.FRAMES, b"rubbish")
    node.wait_for((1, 0), (1, 1))
    wait_until(lambda: gateway.metrics.value("messages_stored_total") == 2, "stored")
    refused = "messages_rejected_total"
    wait_until(lambda: gateway.metrics.value(refused, reason="malformed") == 1, "refused")
    # A node's status, and the hull of one frame.
    wait_until(lambda: gateway.metrics.value("publications_total") == 2, "published")
    text = ask(gateway, "/metrics").text
    for line in (
        "eskin_gateway_messages_received_total 5.0",
        "eskin_gateway_messages_accepted_total 2.0",
        "eskin_gateway_messages_acknowledged_total 2.0",
        'eskin_gateway_messages_rejected_total{reason="malformed"} 1.0',
        "eskin_gateway_spool_messages 0.0",
        "eskin_gateway_broker_connected 1.0",
        "eskin_gateway_forward_latency_seconds_count",
    ):
        assert line in text
    assert "eskin_gateway_healthy 1.0" in text


def test_unknown_page_is_not_found(gateway: Gateway) -> None:
    assert ask(gateway, "/secrets").status_code == 404


@pytest.fixture
def config(settings: GatewaySettings, tmp_path: Path) -> Path:
    file = tmp_path / "gateway.toml"
    file.write_text(f"""
[broker]
host = "127.0.0.1"
port = {settings.broker.port}
[identity]
directory = "{settings.identity.directory}"
site = "{settings.identity.site}"
[cloud]
url = "{settings.cloud.url}"
retry_s = 0.05
[spool]
path = "{settings.spool.path}"
[http]
port = {free_port()}
""")
    return file


def test_process_ends_cleanly_on_sigterm(
    config: Path, tmp_path: Path, cloud: StubCloud, node: WireNode
) -> None:
    log = tmp_path / "log"
    with Running([sys.executable, "-c", _PROGRAM, str(config)], log=log) as process:
        process.wait_for(lambda: "broker connected" in process.output(), "connected")
        node.say(Stream.STATUS, status(0))
        node.wait_for((1, 0))
        assert process.stop() == 0
    lines = log.read_text()
    assert lines.count("ready: gateway=gateway.g1") == 1
    assert "ended: messages_left=0" in lines
    assert "Traceback" not in lines
    assert len(cloud.stored) == 1


def test_killed_process_loses_nothing_it_acknowledged(
    config: Path,
    tmp_path: Path,
    cloud: StubCloud,
    identities: Identities,
    broker: Mosquitto,
) -> None:
    cloud.end()
    process = Running([sys.executable, "-c", _PROGRAM, str(config)], log=tmp_path / "log")
    sent = {number: frame(number).encode() for number in range(1, 200)}
    with process, WireNode(identities.node, identities.site, broker.node_port) as node:
        process.wait_for(lambda: "broker connected" in process.output(), "connected")
        node.say(Stream.STATUS, status(0))
        node.wait_for((1, 0))
        for number in sent:
            node.say(Stream.FRAMES, frame(number))
        process.wait_for(lambda: len(node.acknowledged) > 20, "some are acknowledged")
        process.kill()
        vouched = {sequence for _, sequence in node.acknowledged.copy() if sequence}
        cloud.begin()
        process.start()
        process.wait_for(lambda: process.output().count("broker connected") > 1, "connected again")
        for number in sent:  # the node sends again what it must, and more
            node.say(Stream.FRAMES, frame(number))
        wait_until(lambda: len(cloud.stored) == 200, "the cloud has all")
    stored = [body for _, body in cloud.stored]
    assert len(stored) == len(set(stored))
    assert set(stored) >= {sent[number] for number in vouched}
