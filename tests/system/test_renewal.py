"""A running node, site, gateway and cloud server outlive their certificates: nothing is lost."""

from __future__ import annotations

import subprocess
from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING

import pytest

from eskin.identity import IdentityKind, load_certificates, numbered
from eskin.identity.identity import CHAIN_FILE, ROOT_FILE
from eskin.wire.messages.cbor_map import load
from eskin.wire.messages.header import read_position
from tests.support.brokers import Mosquitto
from tests.support.fleets import RunningFleet
from tests.support.identities import Identities
from tests.support.processes import ESKIN, Running, accepts, free_port, wait_until
from tests.unit.gateway.stub_cloud import StubCloud

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path

pytestmark = pytest.mark.nightly

LIFETIME = timedelta(seconds=9)
NAMES = {
    "fingertip": IdentityKind.NODE,
    "site.main": IdentityKind.SITE,
    "gateway.g1": IdentityKind.GATEWAY,
}


def authority(
    folder: Path, own: Identities, *, lifetime: timedelta = LIFETIME
) -> tuple[Running, int]:
    """The CA service over the test's CA, with short-lived certificates."""
    port = free_port()
    config = folder / "ca.toml"
    config.write_text(
        f'[ca]\ndirectory = "{own.ca}"\nport = {port}\n'
        f"certificate_days = {lifetime.total_seconds() / 86_400}\n"
    )
    running = Running([ESKIN, "pki", "serve", "--config", str(config)], log=folder / "ca.log")
    return running, port


def gateway(folder: Path, own: Identities, broker: Mosquitto, cloud: str, url: str) -> Running:
    config = folder / "gateway.toml"
    config.write_text(
        f'[broker]\nhost = "127.0.0.1"\nport = {broker.gateway_port}\n'
        f'[identity]\ndirectory = "{own.gateway.directory}"\nsite = "{own.site.directory}"\n'
        f'revocations = "{folder / "node.crl.pem"}"\n'
        f'[cloud]\nurl = "{cloud}"\ntimeout_s = 60\n[spool]\npath = "{folder / "spool.sqlite"}"\n'
        f'[http]\nport = 0\n[renewal]\nurl = "{url}"\nevery_s = 0.3\n'
    )
    return Running([ESKIN, "gateway", "--config", str(config)], log=folder / "gateway.log")


def sensor_node(
    folder: Path, own: Identities, broker: Mosquitto, url: str, *, speed: float = 1.0
) -> Running:
    config = folder / "node.toml"
    site = folder / "site.pem"
    site.write_bytes((own.site.directory / CHAIN_FILE).read_bytes())
    config.write_text(
        f'[node]\nname = "fingertip"\nprofile = "fingertip"\nspeed = {speed}\n'
        f"[broker]\nport = {broker.node_port}\nresend_s = 1.0\ndrain_s = 100\n"
        f'[identity]\ndirectory = "{own.node.directory}"\nsite = "{site}"\n'
        f'[flash]\npath = "{folder / "flash.sqlite"}"\n'
        f'[truth]\npath = "{folder / "truth.sqlite"}"\n'
        f'[renewal]\nurl = "{url}"\nevery_s = 0.3\n'
    )
    return Running([ESKIN, "node", "--config", str(config)], log=folder / "node.log")


@pytest.mark.timeout(500)
def test_everything_is_stored_once_over_several_renewals(tmp_path: Path) -> None:
    own = Identities(tmp_path / "pki")
    aged = datetime.now(UTC) - timedelta(seconds=60)
    for name, kind in NAMES.items():
        own.make(kind, name, now=aged, lifetime=timedelta(seconds=90))
    service, port = authority(tmp_path, own)
    url = f"https://127.0.0.1:{port}"
    cloud = StubCloud(own.make(IdentityKind.SERVER, "server.cloud"))
    with service, Mosquitto(tmp_path / "broker", own) as broker, cloud:
        service.wait_for(lambda: accepts(port), "the CA service listens")
        with (
            gateway(tmp_path, own, broker, cloud.url, url) as receiver,
            sensor_node(tmp_path, own, broker, url) as node,
        ):
            renewals(own, 1)
            broker.stop()  # who comes back must show the renewed certificate
            broker.begin()
            before = len(cloud.stored)
            renewals(own, 2)
            wait_until(lambda: len(cloud.stored) > before + 5, "data arrive")
            assert node.stop(seconds=150) == 0
            assert "waiting=0" in node.output(), node.output()
            require_each_once(cloud)
            before = len(cloud.stored)
            node.start()
            wait_until(lambda: len(cloud.stored) > before + 5, "data arrive")
            own.authority.revoke("fingertip")
            refused = "certificate of fingertip was revoked"
            receiver.wait_for(lambda: refused in receiver.output(), "it is refused")


@pytest.mark.timeout(600)
def test_members_of_a_fleet_are_renewed_and_follow_the_roots(tmp_path: Path) -> None:
    pki, names = tmp_path / "pki", numbered("skin", 2)
    own = Identities(pki)
    ended = datetime.now(UTC) - timedelta(seconds=60)
    for name in names:  # no one takes them before they are renewed
        own.make(IdentityKind.NODE, name, now=ended, lifetime=timedelta(seconds=59))
    service, port = authority(tmp_path, own)
    renewal = {"url": f"https://127.0.0.1:{port}", "every_s": 0.3}
    cloud = StubCloud(own.make(IdentityKind.SERVER, "server.cloud"))

    def heard() -> set[str]:
        return {node for node, _ in cloud.stored}

    with service, Mosquitto(tmp_path / "broker", own) as broker, cloud:
        service.wait_for(lambda: accepts(port), "the CA service listens")
        fleet = RunningFleet(
            tmp_path / "fleet", pki, port=broker.node_port, count=2, renewal=renewal
        )
        with gateway(tmp_path, own, broker, cloud.url, str(renewal["url"])), fleet:
            wait_until(lambda: heard() == set(names), "both are heard", seconds=150)
            renewals(own, 1, names)
            cloud.stored.clear()
            wait_until(lambda: heard() == set(names), "both are heard under their next names")
            rotate = [ESKIN, "pki", "rotate", "--root", "--dir", str(own.ca)]
            subprocess.run(rotate, check=True, capture_output=True, timeout=120)
            roots = [pki / name / ROOT_FILE for name in names]
            wait_until(
                lambda: all(len(load_certificates(file)) == 2 for file in roots),
                "both trust the new root, too",
            )
            assert fleet.stop() == 0
            assert "waiting=0" in fleet.output(), fleet.output()


def require_each_once(cloud: StubCloud) -> None:
    """All that the node ever said is stored, and nothing twice."""
    positions = [read_position(load(body)) for _, body in cloud.stored]
    numbers = sorted(position.sequence for position in positions)
    assert numbers == list(range(len(numbers)))
    assert cloud.duplicates == 0


def renewals(own: Identities, count: int, expected: Iterable[str] = NAMES) -> None:
    """Wait until each of them was renewed so many times."""

    def issued() -> list[int]:
        names = [entry.name for entry in own.authority.issued()]
        return [names.count(name) for name in expected]

    enough = [before + count for before in issued()]
    wait_until(
        lambda: all(now >= then for now, then in zip(issued(), enough, strict=True)),
        f"all are renewed {count} times",
    )
