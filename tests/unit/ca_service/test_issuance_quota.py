"""Certificates for one key or token are limited in number."""

from __future__ import annotations

import asyncio
import base64
from datetime import timedelta
from typing import TYPE_CHECKING

import httpx
import pytest
from cryptography.hazmat.primitives import serialization
from eskin_ca.app import create_application
from eskin_ca.csr import make_request
from eskin_ca.issuance_quota import IssuanceQuota, IssuanceQuotaError
from eskin_ca.renewal_service import MOST
from eskin_ca.tokens import TOKENS_FILE, Tokens

from eskin.identity import IdentityKind, new_key
from eskin.wire.envelope import sign
from eskin.wire.topics import RENEWAL
from tests.support.identities import SITE, Identities

if TYPE_CHECKING:
    from pathlib import Path

    from fastapi import FastAPI

NODE = IdentityKind.NODE
DAY = timedelta(days=1)


class Rig:
    """A CA service, and a node that has a certificate."""

    def __init__(self, folder: Path) -> None:
        self.own = Identities(folder)
        self.authority = self.own.authority
        self.tokens = Tokens(self.own.ca / TOKENS_FILE)
        self.app: FastAPI = create_application(self.authority, self.tokens, lifetime=DAY, grace=DAY)

    def post(self, path: str, *bodies: dict[str, str]) -> list[httpx.Response]:
        async def ask() -> list[httpx.Response]:
            transport = httpx.ASGITransport(self.app)
            async with httpx.AsyncClient(transport=transport, base_url="https://ca") as client:
                return [await client.post(path, json=body) for body in bodies]

        return asyncio.run(ask())

    def renewal(self) -> dict[str, str]:
        request = make_request(new_key(), "fingertip").public_bytes(serialization.Encoding.DER)
        signed = sign(request, own=self.own.node, topic=RENEWAL)
        return {"signed": base64.b64encode(signed).decode()}


@pytest.fixture
def rig(tmp_path: Path) -> Rig:
    return Rig(tmp_path)


def test_key_that_is_renewed_again_and_again_is_asked_to_wait(rig: Rig) -> None:
    before = rig.authority.register.length()
    answers = rig.post("/renew", *(rig.renewal() for _ in range(MOST + 5)))
    assert [answer.status_code for answer in answers] == [200] * MOST + [429] * 5
    assert answers[-1].headers["retry-after"]
    assert rig.authority.register.length() == before + MOST


def test_same_key_and_token_get_the_same_certificate(rig: Rig) -> None:
    token, key = rig.tokens.create(NODE, "palm", (), DAY, lines=0, site=SITE), new_key()
    request = make_request(key, "palm").public_bytes(serialization.Encoding.PEM).decode()
    asked = {"token": token, "request": request}
    first, again = rig.post("/enrol", asked, asked)
    assert first.status_code == 200
    assert again.json() == first.json()
    rig.authority.rotate(NODE)
    (other,) = rig.post("/enrol", asked)
    assert other.json() != first.json(), "of the CA that issues now"


def test_server_whose_names_change_is_enrolled_anew(rig: Rig) -> None:
    key = new_key()
    request = make_request(key, "server.cloud").public_bytes(serialization.Encoding.PEM).decode()
    chains = []
    for hosts in (("cloud", "127.0.0.1"), ("127.0.0.1", "cloud"), ("cloud.example",)):
        token = rig.tokens.create(IdentityKind.SERVER, "server.cloud", hosts, DAY, lines=10**6)
        (answer,) = rig.post("/enrol", {"token": token, "request": request})
        chains.append(answer.json()["chain"])
    assert chains[0] == chains[1] != chains[2]


def test_allowance_comes_back_with_time_and_is_not_spent_on_what_fails() -> None:
    now = [0.0]
    allowance = IssuanceQuota(2, 10.0, clock=lambda: now[0])

    def take(name: str) -> None:
        with allowance.take(name):
            pass

    for _ in range(5):
        with pytest.raises(OSError, match="full"), allowance.take("palm"):
            raise OSError("the disk is full")
    for instant in (0.0, 4.0):
        now[0] = instant
        take("palm")
    with pytest.raises(IssuanceQuotaError, match="palm got 2 certificates in 10 s"):
        take("palm")
    take("sole")
    now[0] = 10.0
    take("palm")
    with pytest.raises(IssuanceQuotaError):
        take("palm")
