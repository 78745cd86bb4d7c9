"""The CA service answers so much of one address, and states when to retry."""

from __future__ import annotations

import asyncio
import base64
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import TYPE_CHECKING

import httpx
import pytest
from cryptography import x509
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.hashes import SHA256
from cryptography.x509.oid import NameOID
from eskin_ca.app import create_application
from eskin_ca.client import enrol
from eskin_ca.http_client import NotReadyError
from eskin_ca.problems import REFUSALS
from eskin_ca.service import Server
from eskin_ca.settings import CaSection
from eskin_ca.tokens import TOKENS_FILE, Tokens

from eskin.identity import CertificateAuthority, Identity, IdentityKind, client_context
from eskin.runtime.http_server.rate_limit import LimitsMiddleware, RateLimit
from eskin.wire.envelope import sign
from eskin.wire.topics import RENEWAL
from tests.support.identities import Identities
from tests.support.logs import log_lines
from tests.support.processes import free_port, wait_until

if TYPE_CHECKING:
    from starlette.types import ASGIApp

DAY = timedelta(days=1)


def limited(folder: Path, *, requests_per_s: int, refusals_per_min: int) -> ASGIApp:
    own = Identities(folder)
    app = create_application(own.authority, Tokens(folder / TOKENS_FILE), lifetime=DAY, grace=DAY)
    return LimitsMiddleware(
        app,
        requests=RateLimit.per_second(requests_per_s),
        refused=RateLimit.per_minute(refusals_per_min),
        statuses=REFUSALS,
    )


def self_signed(name: str, issuer: str) -> Identity:
    """An identity that another made for itself, expired."""
    key, year = ec.generate_private_key(ec.SECP256R1()), datetime(2020, 1, 1, tzinfo=UTC)
    subject, by = (x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, n)]) for n in (name, issuer))
    made = x509.CertificateBuilder(by, subject, key.public_key(), 1, year, year + DAY)
    certificate = made.sign(key, SHA256())
    return Identity(Path(), key, (certificate, certificate), (certificate,))


def client(app: ASGIApp, address: str) -> httpx.AsyncClient:
    transport = httpx.ASGITransport(app, client=(address, 1))
    return httpx.AsyncClient(transport=transport, base_url="https://ca")


@pytest.mark.usefixtures("standing_windows")
@pytest.mark.anyio
async def test_flood_from_one_address_is_asked_to_wait(tmp_path: Path) -> None:
    app = limited(tmp_path, requests_per_s=1, refusals_per_min=600)
    async with client(app, "192.0.2.1") as flood:
        answers = [await flood.get("/roots") for _ in range(20)]
        assert [answer.status_code for answer in answers] == [200] * 10 + [429] * 10
        assert answers[-1].headers["retry-after"] == "10"
        assert answers[-1].json()["status"] == 429
    async with client(app, "192.0.2.2") as other:
        assert (await other.get("/roots")).status_code == 200


@pytest.mark.usefixtures("standing_windows")
@pytest.mark.anyio
async def test_guesses_are_limited_and_good_requests_are_not(tmp_path: Path) -> None:
    app = limited(tmp_path, requests_per_s=100, refusals_per_min=2)
    guess = {"token": "guess", "request": "no request"}
    async with client(app, "2001:db8::1") as guesser:
        statuses = [(await guesser.post("/enrol", json=guess)).status_code for _ in range(3)]
        assert statuses == [403, 403, 429]
        answer = await guesser.post("/renew", json={"signed": "AA=="})
        assert answer.status_code == 429
        assert answer.headers["retry-after"] == "60"
        assert (await guesser.get("/revocations/node")).status_code == 200


@pytest.mark.usefixtures("standing_windows")
@pytest.mark.anyio
async def test_guesses_are_logged_within_their_limit_only(tmp_path: Path) -> None:
    app = limited(tmp_path, requests_per_s=100, refusals_per_min=2)
    guess = {"token": "guess", "request": "no request"}
    with log_lines() as lines:
        async with client(app, "192.0.2.1") as guesser:
            for _ in range(20):
                await guesser.post("/enrol", json=guess)
    assert len(lines()) == 2


@pytest.mark.anyio
async def test_name_in_a_request_forges_no_log_line(tmp_path: Path) -> None:
    app = limited(tmp_path, requests_per_s=100, refusals_per_min=100)
    forged = "g\n2026-11-24T00:00:00.000Z INFO forged"
    identity = self_signed(forged, IdentityKind.NODE.issuer)
    signed = base64.b64encode(sign(b"no request", own=identity, topic=RENEWAL)).decode()
    with log_lines() as lines:
        async with client(app, "192.0.2.1") as guesser:
            answer = await guesser.post("/renew", json={"signed": signed})
    assert answer.status_code == 403
    assert forged in answer.json()["detail"]
    assert len(lines()) == 1
    assert all(line.isprintable() for line in lines())


@pytest.mark.usefixtures("standing_windows")
@pytest.mark.anyio
async def test_forwarding_header_hides_no_address(tmp_path: Path) -> None:
    own = CaSection(
        directory=tmp_path / "ca", port=free_port(), names=("127.0.0.1",), refusals_per_min=2
    )
    authority = CertificateAuthority.open(own.directory)
    tokens = Tokens(own.directory / TOKENS_FILE)
    app = create_application(authority, tokens, lifetime=DAY, grace=DAY)
    app.add_middleware(
        LimitsMiddleware,
        requests=RateLimit.per_second(own.requests_per_s),
        refused=RateLimit.per_minute(own.refusals_per_min),
        statuses=REFUSALS,
    )
    server = Server(app, own, authority)
    serving = asyncio.create_task(server.serve())
    await asyncio.to_thread(wait_until, lambda: server.started, "it listens")
    guess = {"token": "guess", "request": "no request"}
    context, url = client_context(authority.root_file), f"https://127.0.0.1:{own.port}"
    async with httpx.AsyncClient(verify=context, base_url=url, timeout=60) as guesser:
        statuses = [
            (
                await guesser.post("/enrol", json=guess, headers={"X-Forwarded-For": f"10.0.0.{k}"})
            ).status_code
            for k in range(3)
        ]
    server.should_exit = True
    await serving
    assert statuses == [403, 403, 429]


def test_party_that_is_asked_to_wait_comes_again(tmp_path: Path) -> None:
    own = Identities(tmp_path)
    (tmp_path / "root.pem").write_bytes(own.authority.root_file.read_bytes())
    (tmp_path / "palm.token").write_text("token")
    busy = httpx.MockTransport(lambda _: httpx.Response(429, headers={"Retry-After": "10"}))
    with httpx.Client(transport=busy) as asked, pytest.raises(NotReadyError, match="429"):
        enrol("https://ca", tmp_path, "palm", tmp_path / "palm", client=asked)
