"""The root CA is replaced under traffic: no restart, no refused connection, each frame once."""

from __future__ import annotations

import logging
import shutil
import ssl
import subprocess
from contextlib import ExitStack
from datetime import timedelta
from threading import Event, Thread
from typing import TYPE_CHECKING, Self

import httpx
import pytest
from eskin_ca.mosquitto_agent import end_connections
from eskin_ca.renewal_agent import RenewalAgent

from eskin.identity import Identity, IdentityKind, client_context, load_certificates
from eskin.identity.identity import CHAIN_FILE, ROOT_FILE
from eskin.runtime.settings import RenewalSection
from tests.support.brokers import Mosquitto
from tests.support.files import ask, write_settings
from tests.support.identities import Identities
from tests.support.processes import ESKIN, Running, accepts, free_port, wait_until
from tests.system.test_renewal import authority, gateway, sensor_node
from tests.system.test_takeover import require_each_once
from tests.unit.services.party import Party

if TYPE_CHECKING:
    from pathlib import Path

    from cryptography import x509

pytestmark = pytest.mark.nightly

log = logging.getLogger(__name__)

_PAUSE_S = 0.2

PARTIES = {
    "server.broker": IdentityKind.SERVER,
    "server.cloud": IdentityKind.SERVER,
    "gateway.g1": IdentityKind.GATEWAY,
    "site.main": IdentityKind.SITE,
    "fingertip": IdentityKind.NODE,
    "client.demo": IdentityKind.CLIENT,
}


class Site:
    """CA service, guarded Mosquitto, cloud, gateway, node, and a client that is kept renewed."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.pki = folder / "pki"
        self.own = Identities(self.pki)
        for name, kind in PARTIES.items():
            self.own.make(kind, name)
        self.service, self.port = authority(folder, self.own, lifetime=timedelta(days=90))
        self.url = f"https://127.0.0.1:{self.port}"
        self.anchors = folder / "broker"
        guard = [ESKIN, "pki", "guard", "--url", self.url, "--folder", str(self.anchors),
                 "--identity", str(self.pki / "server.broker"), "--"]  # fmt: skip
        self.broker = Mosquitto(self.anchors, self.own, guard=guard)
        self.store = folder / "store.sqlite"
        self.ingest = free_port()
        self.cloud = self._make_cloud()
        url = f"https://127.0.0.1:{self.ingest}/api/v1/ingest"
        self.gateway = gateway(folder, self.own, self.broker, url, self.url)
        self.node = sensor_node(folder, self.own, self.broker, self.url, speed=0.2)
        client = RenewalSection(url=self.url, every_s=0.3)
        self.client = RenewalAgent(client, [self.pki / "client.demo"])
        self._running = ExitStack()

    def _make_cloud(self) -> Running:
        config = write_settings(self.folder / "cloud.toml", {
            "store": {"path": self.store},
            "people": {"port": free_port()},
            "gateways": {"port": self.ingest, "identity": self.pki / "server.cloud",
                         "revocations": self.folder / "gateway.crl.pem"},
            "renewal": {"url": self.url, "every_s": 0.3},
        })  # fmt: skip
        return Running([ESKIN, "cloud", "--config", str(config)], log=self.folder / "cloud.log")

    def __enter__(self) -> Self:
        with ExitStack() as running:
            running.enter_context(self.service)
            self.service.wait_for(lambda: accepts(self.port), "it listens")
            running.enter_context(self.cloud)
            for part in (self.broker, self.gateway, self.node, self.client):
                running.enter_context(part)
            listens = "the cloud listens"
            self.cloud.wait_for(lambda: accepts(self.ingest), listens)
            self._running = running.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self._running.close()

    def pki_command(self, *arguments: str) -> str:
        argv = [ESKIN, "pki", *arguments, "--dir", str(self.own.ca)]
        done = subprocess.run(argv, capture_output=True, text=True, timeout=120, check=False)
        return done.stderr if done.returncode else ""

    def party(self, identity: Identity) -> Party:
        ports = {
            IdentityKind.NODE: self.broker.node_port,
            IdentityKind.CLIENT: self.broker.client_port,
        }
        root = self.pki / "client.demo" / ROOT_FILE
        return Party(identity, ports[identity.kind], root=root)

    def roots(self) -> dict[str, tuple[x509.Certificate, ...]]:
        """The roots that each party trusts."""
        return {name: load_certificates(self.pki / name / ROOT_FILE) for name in PARTIES}

    def issuers(self) -> dict[str, x509.Certificate]:
        """Who issued each party's certificate."""
        return {name: load_certificates(self.pki / name / CHAIN_FILE)[1] for name in PARTIES}

    def wait_for_more(self) -> None:
        """Wait until the cloud has stored some more."""
        query = "SELECT count(*) FROM frames"
        enough = ask(self.store, query)[0][0] + 5
        wait_until(lambda: ask(self.store, query)[0][0] > enough, "frames are stored")

    def is_heard_anew(self) -> bool:
        """Whether the gateway has taken something that the node's present certificate sealed."""
        own = Identity.load(self.pki / "fingertip")
        query = "SELECT thumbprint FROM nodes WHERE node = 'fingertip'"
        return ask(self.folder / "spool.sqlite", query) == [(own.thumbprint,)]


class Visitor(Thread):
    """Goes on connecting to every server, and remembers who refused."""

    def __init__(self, site: Site) -> None:
        super().__init__(daemon=True)
        self._site = site
        self._stopping = Event()
        self.visits = 0
        self.refusals: list[str] = []

    def run(self) -> None:
        folder = self._site.pki / "client.demo"
        while not self._stopping.is_set():
            self._visit("broker", lambda: self._subscribe(folder))
            for name, port in (("cloud", self._site.ingest), ("CA service", self._site.port)):
                self._visit(name, lambda port=port: self._get(folder, port))
            self.visits += 1
            self._stopping.wait(_PAUSE_S)

    def end(self) -> None:
        self._stopping.set()
        self.join()

    def _visit(self, name: str, do: object) -> None:
        try:
            assert callable(do)
            do()
        except (OSError, httpx.TransportError, AssertionError, ssl.SSLError) as error:
            self.refusals.append(f"{name}: {error}")

    def _subscribe(self, folder: Path) -> None:
        with self._site.party(Identity.load(folder)) as party:
            assert party.connected

    def _get(self, folder: Path, port: int) -> None:
        context = client_context(folder / ROOT_FILE, Identity.load(folder))
        httpx.get(f"https://127.0.0.1:{port}/healthz", verify=context, timeout=60)


@pytest.mark.timeout(1200)
def test_root_is_replaced_under_traffic(tmp_path: Path) -> None:
    with Site(tmp_path) as site:
        site.wait_for_more()
        (old,) = site.own.authority.roots
        stolen = shutil.copytree(site.pki / "fingertip", tmp_path / "stolen")
        visitor = Visitor(site)
        visitor.start()
        rotate(site, old)
        visitor.end()
        log.info("visits to each server: %d", visitor.visits)
        assert visitor.visits > 3
        assert visitor.refusals == []
        # A client that connects anew is let in, and what the old root has signed is not.
        end_connections(site.anchors / "control.sock", ["fingertip", "gateway.g1"])
        site.wait_for_more()
        with site.party(Identity.load(stolen)) as thief:
            assert thief.refused
        assert site.node.stop(seconds=150) == 0
        assert "waiting=0" in site.node.output(), site.node.output()
        assert "untrusted" not in site.gateway.output()
    require_each_once(site.store)


def rotate(site: Site, old: x509.Certificate) -> None:
    """The operator's three steps."""
    assert site.pki_command("rotate", "--root") == ""
    wait_until(
        lambda: all(len(roots) == 2 for roots in site.roots().values()),
        "everybody trusts both roots",
    )
    before = site.issuers()
    assert "not everybody may know it" in site.pki_command("switch")
    assert site.pki_command("switch", "--force") == ""
    wait_until(
        lambda: all(issuer != before[name] for name, issuer in site.issuers().items()),
        "everybody has a certificate under the new root",
    )
    # What was sealed under the old one is through then, however slow the machine is.
    wait_until(site.is_heard_anew, "the node's messages come under its new certificate")
    wait_until(lambda: site.pki_command("retire", "--root") == "", "everybody is renewed")
    wait_until(
        lambda: all(roots != (old,) and len(roots) == 1 for roots in site.roots().values()),
        "no party trusts the old root",
    )
    site.wait_for_more()
