"""Mosquitto under its guard: a client that is revoked is out, also on an open connection.

How soon: at the guard's next look, see ``tests/unit/ca_service/test_mosquitto_agent.py``.
"""

from __future__ import annotations

import logging
import subprocess
import time
from typing import TYPE_CHECKING

import pytest

from eskin.identity import Identity, IdentityKind
from tests.support.brokers import Mosquitto
from tests.support.identities import Identities
from tests.support.processes import ESKIN, accepts, wait_until
from tests.system.test_renewal import authority
from tests.unit.services.party import Party

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

log = logging.getLogger(__name__)


class Guarded:
    """A CA service, and Mosquitto under the guard."""

    def __init__(self, own: Identities, broker: Mosquitto) -> None:
        self.own = own
        self.broker = broker
        self.root = own.node.directory / "root.pem"

    def party(self, identity: Identity) -> Party:
        return Party(identity, self.broker.node_port, root=self.root)

    def pki(self, *arguments: str) -> None:
        argv = [ESKIN, "pki", *arguments, "--dir", str(self.own.ca)]
        subprocess.run(argv, check=True, capture_output=True, timeout=120)


@pytest.fixture
def guarded(tmp_path: Path) -> Iterator[Guarded]:
    own = Identities(tmp_path / "pki")
    service, port = authority(tmp_path, own)
    folder = tmp_path / "broker"
    guard = [
        *(ESKIN, "pki", "guard", "--url", f"https://127.0.0.1:{port}"),
        *("--identity", str(tmp_path / "pki" / "server.broker"), "--folder", str(folder), "--"),
    ]
    with service:
        service.wait_for(lambda: accepts(port), "the CA service listens")
        with Mosquitto(folder, own, guard=guard) as broker:
            yield Guarded(own, broker)


@pytest.mark.nightly
def test_revoked_node_is_out_and_stays_out(guarded: Guarded) -> None:
    palm = guarded.own.make(IdentityKind.NODE, "palm")
    with guarded.party(guarded.own.node) as lost, guarded.party(palm) as other:
        assert lost.connected
        assert other.connected
        begun = time.monotonic()
        guarded.own.authority.revoke("fingertip")
        wait_until(lambda: lost.refused, "its open connection is ended")
        log.info("revoked to ended: %.2f s", time.monotonic() - begun)
        assert other.connected
    with guarded.party(guarded.own.node) as again:
        assert again.refused
    with guarded.party(palm) as other:
        assert other.connected


@pytest.mark.nightly
def test_certificates_of_both_cas_pass_until_the_old_one_is_retired(guarded: Guarded) -> None:
    old = guarded.own.node
    guarded.pki("rotate", "--kind", "node")
    new = guarded.own.make(IdentityKind.NODE, "palm")
    assert new.chain[1] != old.chain[1]

    def passes(identity: Identity) -> bool:
        with guarded.party(identity) as party:
            return party.connected

    wait_until(lambda: passes(new), "the new CA's are let in")
    assert passes(old)
    guarded.pki("revoke", "--name", "palm")
    wait_until(lambda: not passes(new), "the new CA revokes")
    assert passes(old)
