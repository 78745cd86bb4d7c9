"""Keepers that share a folder, and a CA service that outlives its own certificate."""

from __future__ import annotations

import logging
import ssl
from datetime import UTC, datetime, timedelta
from threading import Barrier, Thread
from typing import TYPE_CHECKING

import pytest
from cryptography import x509
from eskin_ca.client import fetch_anchor
from eskin_ca.renewal_agent import RenewalAgent

from eskin.identity import Identity, IdentityKind
from eskin.runtime.settings import RenewalSection
from tests.support.identities import Identities
from tests.support.processes import ESKIN, Running, accepts, free_port

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

SHORT_S = 15.0
LONG_S = 90 * 86_400.0
GATEWAYS = 4


class Service(Running):
    """The CA service, whose certificates live for some seconds."""

    def __init__(self, folder: Path, *, life_s: float) -> None:
        self.port = free_port()
        self.own = Identities(folder / "pki")
        config = folder / "ca.toml"
        config.write_text(
            f'[ca]\ndirectory = "{self.own.ca}"\nport = {self.port}\n'
            f"certificate_days = {life_s / 86_400}\n"
        )
        argv = [ESKIN, "pki", "serve", "--config", str(config)]
        super().__init__(argv, log=folder / "ca.log")

    @property
    def serial(self) -> int:
        """Number of the certificate that it shows."""
        shown = ssl.get_server_certificate(("127.0.0.1", self.port))
        return x509.load_pem_x509_certificate(shown.encode()).serial_number


@pytest.fixture
def service(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Service]:
    with Service(tmp_path, life_s=request.param) as running:
        running.wait_for(lambda: accepts(running.port), "it listens")
        yield running


def test_strange_answer_ends_nothing_and_is_counted_and_said_once(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    caplog.set_level(logging.WARNING)
    own = Identities(tmp_path)
    renewed: list[str] = []

    def strange(*_: object) -> None:
        raise KeyError("chain")

    def renew(_: str, directory: Path) -> Identity:
        renewed.append(directory.name)
        return own.site

    monkeypatch.setattr("eskin_ca.renewal_agent.fetch_roots", strange)
    site = own.make(IdentityKind.SITE, "site.old", lifetime=timedelta(seconds=-1))
    monkeypatch.setattr("eskin_ca.renewal_agent.renew", renew)
    renewal_agent = RenewalAgent(RenewalSection(url="https://127.0.0.1:1"), [site.directory])
    for _ in range(3):
        renewal_agent.look()
    assert [*renewal_agent.fault_log.faults] == ["roots"]
    assert renewed == ["site.old"] * 3
    assert [record.exc_info is not None for record in caplog.records] == [True]


@pytest.mark.nightly
@pytest.mark.parametrize("service", [SHORT_S], indirect=True)
def test_service_renews_its_own_certificate_while_it_runs(service: Service) -> None:
    first = service.serial
    service.wait_for(lambda: service.serial != first, "it shows another one")
    # Requests are still answered, under the same root.
    url = f"https://127.0.0.1:{service.port}"
    anchor = service.own.node.directory / "anchor.pem"
    fetch_anchor(url, service.own.node.directory, IdentityKind.NODE, anchor)
    assert anchor.read_bytes() == service.own.authority.anchor_file(IdentityKind.NODE).read_bytes()


@pytest.mark.parametrize("service", [LONG_S], indirect=True)
def test_gateways_that_share_a_site_s_folder_renew_it_once(
    service: Service, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.WARNING)
    aged = datetime.now(UTC) - timedelta(days=80)
    site = service.own.make(IdentityKind.SITE, "site.main", now=aged, lifetime=timedelta(days=90))
    settings = RenewalSection(url=f"https://127.0.0.1:{service.port}")
    together = Barrier(GATEWAYS)

    def look() -> None:
        renewal_agent = RenewalAgent(settings, [site.directory])
        together.wait()
        renewal_agent.look()

    before = len(service.own.authority.issued())
    threads = [Thread(target=look) for _ in range(GATEWAYS)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    issued = [entry.name for entry in service.own.authority.issued()[before:]]
    assert issued.count("site.main") == 1
    assert caplog.messages == []
