"""After any interruption of the CA, every issued certificate can be revoked."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from contextlib import contextmanager
from datetime import timedelta
from typing import TYPE_CHECKING

import pytest
from cryptography.hazmat.primitives import serialization
from eskin_ca.csr import make_request
from eskin_ca.renewal_service import RenewalService
from typer.testing import CliRunner

from eskin.cli.pki import pki
from eskin.errors import IdentityError, UntrustedCertificateError
from eskin.identity import (
    CertificateAuthority,
    ChainVerifier,
    IdentityKind,
    crl_publisher,
    der,
    new_key,
    next_key,
)
from eskin.identity import issuance_register as register_module
from eskin.identity.issuance_log import IssuanceLog
from eskin.runtime.digest import with_check, without_check
from eskin.wire.envelope import sign
from eskin.wire.topics import RENEWAL
from tests.support.identities import SITE, Identities

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from cryptography import x509

NODE = IdentityKind.NODE
HOUR = timedelta(hours=1)
OPEN = """
import sys, time
from pathlib import Path
from eskin.identity import CertificateAuthority
print("ready", flush=True)
for line in sys.stdin:
    instant, folder = line.rstrip().split(" ", 1)
    while time.time() < float(instant):
        pass
    CertificateAuthority.open(Path(folder))
    print("ready", flush=True)
"""


class Cut(BaseException):
    """The process ends here."""


def cut(*_: object, **__: object) -> None:
    """End the process."""
    raise Cut


class Rig:
    """A CA, and a node that asks it to be renewed, always with the same request."""

    def __init__(self, folder: Path) -> None:
        self.own = Identities(folder)
        self.authority = self.own.authority
        self.renewals = RenewalService(self.authority, lifetime=HOUR, grace=HOUR)
        node = self.own.make(NODE, "palm")
        request = make_request(next_key(node.directory), "palm")
        self.asked = sign(request.public_bytes(serialization.Encoding.DER), own=node, topic=RENEWAL)

    def renew(self) -> tuple[x509.Certificate, ...]:
        return self.renewals.renew(self.asked)

    def require_refused(self, chain: tuple[x509.Certificate, ...]) -> None:
        trust = ChainVerifier(*self.authority.roots)
        trust.revocations(NODE, self.authority.revocations_file(NODE).read_bytes())
        with pytest.raises(UntrustedCertificateError, match="was revoked"):
            trust.verify([der(certificate) for certificate in chain], NODE)


@pytest.fixture
def rig(tmp_path: Path) -> Rig:
    return Rig(tmp_path)


@pytest.mark.parametrize(
    ("of", "step"),
    [(IssuanceLog, "add"), (register_module, "write_whole")],
    ids=["ledger", "chain"],
)
@pytest.mark.parametrize("fault", [OSError(28, "No space left on device"), Cut()], ids=repr)
def test_certificate_whose_issue_was_cut_off_can_be_revoked(
    rig: Rig, monkeypatch: pytest.MonkeyPatch, of: object, step: str, fault: BaseException
) -> None:
    def fail(*_: object, **__: object) -> None:
        raise fault

    with monkeypatch.context() as patched:
        patched.setattr(of, step, fail)
        with pytest.raises(type(fault)):
            rig.renew()
    chain = rig.renew()
    assert f"{chain[0].serial_number:x}" in {entry.serial for entry in rig.authority.issued()}
    rig.authority.revoke("palm")
    rig.require_refused(chain)


def test_chain_that_the_ledger_does_not_know_is_not_given(rig: Rig) -> None:
    ledger = rig.authority.directory / "ledger.jsonl"
    noted = ledger.read_bytes()
    lost = rig.renew()
    ledger.write_bytes(noted)
    assert rig.authority.latest("palm") is None
    assert rig.renew() != lost
    rig.authority.revoke("palm")
    assert rig.authority.latest("palm") is None
    assert rig.authority.register.is_revoked(lost[0]), "as its name was"


def revoke_cut_off(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    """Revoke, and be ended before the list is written."""
    with monkeypatch.context() as patched:
        patched.setattr(crl_publisher, "write_whole", cut)
        with pytest.raises(Cut):
            rig.authority.revoke("palm")


def test_revocation_that_was_cut_off_is_published_by_the_next_look(
    rig: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    chain = rig.authority.latest("palm")
    assert chain is not None
    revoke_cut_off(rig, monkeypatch)
    assert rig.authority.must_refresh(NODE)
    CertificateAuthority(rig.authority.directory).refresh_revocations(NODE)
    assert not rig.authority.must_refresh(NODE)
    rig.require_refused(chain)


def test_revocation_that_was_cut_off_is_published_by_another(
    rig: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    chain = rig.authority.latest("palm")
    assert chain is not None
    revoke_cut_off(rig, monkeypatch)
    command = ["revoke", "--dir", str(rig.authority.directory), "--name", "palm"]
    done = CliRunner().invoke(pki, command)
    assert done.exit_code == 0
    assert "palm was revoked before; its kind's revocation list is signed anew" in done.stdout
    rig.require_refused(chain)
    with pytest.raises(IdentityError, match="no certificate was issued to 'sole'"):
        rig.authority.revoke("sole")


@pytest.mark.parametrize("damage", [None, b"", b"no list"])
def test_list_that_is_lost_or_damaged_stops_no_revocation(rig: Rig, damage: bytes | None) -> None:
    chain, file = rig.authority.latest("palm"), rig.authority.revocations_file(NODE)
    assert chain is not None
    file.unlink()
    if damage is not None:
        file.write_bytes(damage)
    assert rig.authority.must_refresh(NODE)
    rig.authority.revoke("palm")
    rig.require_refused(chain)


@pytest.mark.parametrize("damage", [None, b"", b"no certificate"])
def test_older_ledger_revokes_without_the_chain_at_hand(rig: Rig, damage: bytes | None) -> None:
    chain, ledger = rig.authority.latest("palm"), rig.authority.directory / "ledger.jsonl"
    assert chain is not None
    entries = [without_check(json.loads(line)) for line in ledger.read_text().splitlines()]
    for entry in entries:
        del entry["key"]
    ledger.write_text("".join(json.dumps(with_check(entry)) + "\n" for entry in entries))
    kept = rig.authority.directory / "issued" / "palm.pem"
    kept.unlink()
    if damage is not None:
        kept.write_bytes(damage)
    (revoked,) = CertificateAuthority(rig.authority.directory).revoke("palm")
    assert revoked.key == ""
    rig.require_refused(chain)


def test_two_processes_that_open_a_fresh_folder_make_one_ca(tmp_path: Path) -> None:
    with opener() as one, opener() as two:
        for attempt in range(8):
            folder = tmp_path / str(attempt) / "ca"
            instant = time.time() + 0.1
            for process in (one, two):
                assert process.stdin is not None
                process.stdin.write(f"{instant} {folder}\n")
                process.stdin.flush()
            for process in (one, two):
                await_ready(process)
            authority = CertificateAuthority(folder)
            for kind, name in ((NODE, "palm"), (IdentityKind.GATEWAY, "gateway.a")):
                chain = authority.issue(kind, name, new_key().public_key(), site=SITE)
                ChainVerifier(*authority.roots).verify([der(each) for each in chain], kind)


@contextmanager
def opener() -> Iterator[subprocess.Popen[str]]:
    """A process that opens the folders that it is notified, each at an instant; all is imported."""
    argv = [sys.executable, "-c", OPEN]
    with subprocess.Popen(
        argv, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:
        await_ready(process)
        yield process


def await_ready(process: subprocess.Popen[str]) -> None:
    assert process.stdout is not None
    assert process.stdout.readline() == "ready\n"
