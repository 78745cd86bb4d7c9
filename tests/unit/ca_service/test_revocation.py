"""A revoked identity gets no further certificate."""

from __future__ import annotations

import asyncio
import json
import subprocess
import sys
import time
from dataclasses import asdict
from datetime import UTC, datetime, timedelta
from threading import Event, Thread
from typing import TYPE_CHECKING

import httpx
import pytest
from cryptography.hazmat.primitives import serialization
from eskin_ca.app import create_application
from eskin_ca.csr import make_request
from eskin_ca.renewal_service import RenewalService
from eskin_ca.tokens import TOKENS_FILE, Tokens

from eskin.errors import IdentityError, LockedError, UntrustedCertificateError
from eskin.identity import (
    CertificateAuthority,
    ChainVerifier,
    Identity,
    IdentityKind,
    der,
    new_key,
)
from eskin.identity.issuance_log import IssuanceLog, Issued, Revocation
from eskin.runtime.digest import with_check, without_check
from eskin.runtime.files import lock as file_lock
from eskin.runtime.files.lock import LockFile
from eskin.wire.envelope import sign
from eskin.wire.topics import RENEWAL
from tests.support.identities import SITE

if TYPE_CHECKING:
    from pathlib import Path

    from cryptography.hazmat.primitives.asymmetric import ec

NODE = IdentityKind.NODE
HOUR = timedelta(hours=1)
REVOKE = """
import sys
from pathlib import Path
from eskin.identity import CertificateAuthority
CertificateAuthority(Path(sys.argv[1])).revoke(sys.argv[2])
"""


class Rig:
    """A CA service whose tokens are made by hand."""

    def __init__(self, folder: Path) -> None:
        self.authority = CertificateAuthority.open(folder)
        self.tokens = Tokens(folder / TOKENS_FILE)
        self._app = create_application(self.authority, self.tokens, lifetime=HOUR, grace=HOUR)

    def enrol(self, token: str, name: str, key: ec.EllipticCurvePrivateKey) -> httpx.Response:
        request = make_request(key, name).public_bytes(serialization.Encoding.PEM).decode()
        return asyncio.run(self._post({"token": token, "request": request}))

    async def _post(self, body: dict[str, str]) -> httpx.Response:
        transport = httpx.ASGITransport(self._app)
        async with httpx.AsyncClient(transport=transport, base_url="https://ca") as client:
            return await client.post("/enrol", json=body)

    def token(self, name: str, count: int = 0) -> str:
        lines = self.authority.register.length()
        return self.tokens.create(NODE, name, (), HOUR, lines=lines, site=SITE, count=count)


@pytest.fixture
def rig(tmp_path: Path) -> Rig:
    return Rig(tmp_path / "ca")


def refused(answer: httpx.Response, words: str) -> None:
    assert answer.status_code == 403, answer.text
    assert words in answer.json()["detail"]


@pytest.mark.parametrize(("stem", "name", "count"), [("palm", "palm", 0), ("skin", "skin-0001", 3)])
def test_revoked_key_enrols_with_no_token(rig: Rig, stem: str, name: str, count: int) -> None:
    key, token = new_key(), rig.token(stem, count)
    assert rig.enrol(token, name, key).status_code == 200
    assert rig.enrol(token, name, key).status_code == 200
    rig.authority.revoke(name)
    refused(rig.enrol(token, name, key), "this key was revoked")
    refused(rig.enrol(token, name, new_key()), f"{name} was revoked on")
    if count:
        assert rig.enrol(token, "skin-0002", new_key()).status_code == 200
    fresh = rig.token(name)
    refused(rig.enrol(fresh, name, key), "this key was revoked")
    assert rig.enrol(fresh, name, new_key()).status_code == 200
    refused(rig.enrol(rig.token("other"), "other", key), "this key was revoked")
    assert CertificateAuthority(rig.authority.directory).issued() == rig.authority.issued()


def test_token_that_was_not_used_is_void_once_its_name_was_revoked(rig: Rig) -> None:
    rig.authority.issue(NODE, "palm", new_key().public_key(), site=SITE)
    token = rig.token("palm")
    rig.authority.revoke("palm")
    key = new_key()
    refused(rig.enrol(token, "palm", key), "was made before")
    assert rig.enrol(rig.token("palm"), "palm", key).status_code == 200


def test_key_from_before_keys_were_noted_is_refused_too(rig: Rig) -> None:
    key, ledger = new_key(), rig.authority.directory / "ledger.jsonl"
    rig.enrol(rig.token("palm"), "palm", key)
    noted = without_check(json.loads(ledger.read_text()))
    del noted["key"]
    ledger.write_text(json.dumps(with_check(noted)) + "\n")
    rig.authority.revoke("palm")
    refused(rig.enrol(rig.token("palm"), "palm", key), "this key was revoked")


def test_revocation_wins_against_a_thief_who_keeps_renewing(tmp_path: Path) -> None:
    authority, key = CertificateAuthority.open(tmp_path / "ca"), new_key()
    renewals = RenewalService(authority, lifetime=HOUR, grace=HOUR, most=10**6)
    chain = authority.issue(NODE, "palm", key.public_key(), site=SITE)
    held = [Identity.save(tmp_path / "palm", key=key, chain=chain, roots=authority.roots)]
    stopping = Event()

    def steal() -> None:
        while not stopping.is_set():
            fresh = new_key()
            request = make_request(fresh, "palm").public_bytes(serialization.Encoding.DER)
            try:
                chain = renewals.renew(sign(request, own=held[-1], topic=RENEWAL))
            except IdentityError:
                return
            held.append(Identity(tmp_path, fresh, chain, authority.roots))

    authority.rotate(NODE)
    thief = Thread(target=steal)
    thief.start()
    while len(held) < 5:
        time.sleep(0.01)
    argv = [sys.executable, "-c", REVOKE, str(authority.directory), "palm"]
    subprocess.run(argv, check=True, timeout=120)
    data = authority.revocations_file(NODE).read_bytes()
    stopping.set()
    thief.join()
    assert [entry for entry in authority.issued() if entry.revoked is None] == []
    trust = ChainVerifier(*authority.roots)
    trust.revocations(NODE, data)
    for own in held:
        with pytest.raises(UntrustedCertificateError, match="was revoked"):
            trust.verify([der(certificate) for certificate in own.chain], NODE)


def test_list_that_is_signed_meanwhile_omits_no_revocation(tmp_path: Path) -> None:
    authority = CertificateAuthority.open(tmp_path / "ca")
    names = ("palm", "fingertip")
    chains = [authority.issue(NODE, name, new_key().public_key(), site=SITE) for name in names]
    stopping = Event()

    def keep_signing() -> None:
        other = CertificateAuthority(tmp_path / "ca")
        while not stopping.is_set():
            other.write_revocations(NODE)

    signer = Thread(target=keep_signing)
    signer.start()
    authority.revoke("palm")
    authority.revoke("fingertip")
    stopping.set()
    signer.join()
    written = authority.revocations_file(NODE).read_bytes()
    trust = ChainVerifier(*authority.roots)
    trust.revocations(NODE, written)
    for chain in chains:
        with pytest.raises(UntrustedCertificateError, match="was revoked"):
            trust.verify([der(certificate) for certificate in chain], NODE)


def test_holder_of_the_turn_may_take_it_again_and_no_other(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(file_lock, "PATIENCE_S", 0.05)
    authority = CertificateAuthority.open(tmp_path / "ca")
    other = CertificateAuthority(tmp_path / "ca")
    with authority.changing():
        authority.issue(NODE, "palm", new_key().public_key(), site=SITE)
        with pytest.raises(LockedError, match=r"ledger\.jsonl: another process uses it"):
            other.revoke("palm")
        faults: list[Exception] = []

        def revoke() -> None:
            try:
                authority.revoke("palm")
            except LockedError as error:
                faults.append(error)

        thread = Thread(target=revoke)
        thread.start()
        thread.join()
        assert len(faults) == 1
    assert [entry.revoked for entry in other.issued()] == [None]
    assert len(other.revoke("palm")) == 1


def test_service_that_cannot_have_the_turn_asks_to_come_again(
    rig: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(file_lock, "PATIENCE_S", 0.05)
    key, token = new_key(), rig.token("palm")
    with LockFile(rig.authority.directory / "ledger.jsonl"):
        answer = rig.enrol(token, "palm", key)
    assert answer.status_code == 503
    assert int(answer.headers["retry-after"]) > 0
    assert rig.enrol(token, "palm", key).status_code == 200


def test_folder_that_cannot_be_written_is_a_clear_error_and_can_be_listed(tmp_path: Path) -> None:
    authority = CertificateAuthority.open(tmp_path)
    authority.issue(NODE, "palm", new_key().public_key(), site=SITE)
    lock = tmp_path / "ledger.jsonl.lock"
    lock.unlink()
    lock.mkdir()  # root may write a read-only folder
    with pytest.raises(IdentityError, match="folder cannot be written, so nothing is changed"):
        CertificateAuthority(tmp_path).revoke("palm")
    assert [entry.revoked for entry in CertificateAuthority(tmp_path).issued()] == [None]


def test_ledger_is_read_on_as_it_grows_and_anew_where_it_was_replaced(tmp_path: Path) -> None:
    path = tmp_path / "ledger.jsonl"
    reader, writer = IssuanceLog(path), IssuanceLog(path)
    palm = Issued("a1", "node", "palm", "2030-01-01T00:00:00+00:00", key="k1")
    assert reader.entries() == []
    writer.add(palm)
    assert reader.entries() == [palm]
    gone = palm.revoke("2029-01-01T00:00:00+00:00")
    line = json.dumps(with_check(asdict(gone))) + "\n"
    with path.open("a") as file:
        file.write(line[:30])
    assert reader.entries() == [palm], "half a line is not there yet"
    with path.open("a") as file:
        file.write(line[30:])
    assert reader.entries() == [gone]
    assert reader.entry("a1") == gone
    assert reader.is_revoked_key("k1")
    assert reader.revocation("palm") == Revocation(2, datetime(2029, 1, 1, tzinfo=UTC))
    backup = tmp_path / "backup"
    backup.write_text(json.dumps(with_check(asdict(palm))) + "\n")
    backup.replace(path)
    assert reader.entries() == [palm]
    assert not reader.is_revoked_key("k1")
    assert reader.revocation("palm") is None


@pytest.mark.parametrize("off", [-1, 1])
def test_tokens_go_by_the_order_of_things_not_by_a_clock_that_is_wrong(
    tmp_path: Path, off: int
) -> None:
    clock = [datetime.now(UTC)]
    authority = CertificateAuthority.open(tmp_path / "ca")
    tokens = Tokens(tmp_path / TOKENS_FILE, clock=lambda: clock[0])
    register = authority.register

    def made(name: str) -> str:
        return tokens.create(NODE, name, (), 9 * HOUR, lines=register.length(), site=SITE)

    for name in ("palm", "sole"):
        authority.issue(NODE, name, new_key().public_key(), site=SITE)
    clock[0] += off * HOUR
    before = made("palm")
    authority.revoke("palm")
    authority.revoke("sole")
    after = made("sole")
    clock[0] -= off * HOUR
    reopened = Tokens(tmp_path / TOKENS_FILE)
    with pytest.raises(IdentityError, match=r"palm was revoked on .* was made before"):
        reopened.redeem(before, b"key", revocation=register.revocation)
    assert reopened.redeem(after, b"key", revocation=register.revocation).name == "sole"


def test_token_from_before_lines_were_noted_goes_by_its_time(tmp_path: Path) -> None:
    path, now = tmp_path / TOKENS_FILE, datetime.now(UTC)
    token = Tokens(path, clock=lambda: now).create(NODE, "palm", (), HOUR, lines=7, site=SITE)
    entry = without_check(json.loads(path.read_bytes())[0])
    del entry["lines"]
    path.write_text(json.dumps([with_check(entry)]))
    tokens = Tokens(path)
    with pytest.raises(IdentityError, match="was made before"):
        tokens.redeem(token, b"key", revocation=lambda _: Revocation(3, now))
    earlier = Revocation(9, now - timedelta(seconds=1))
    assert tokens.redeem(token, b"key", revocation=lambda _: earlier).name == "palm"
