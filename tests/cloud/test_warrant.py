"""Gateways must prove who they are, for each batch."""

from __future__ import annotations

from datetime import timedelta
from typing import TYPE_CHECKING, Any
from unittest.mock import Mock

import jwt
import pytest

from cloud.ingest.gatekeeper import Gatekeeper
from cloud.ingest.replay import Replay
from cloud.settings import GatewaysSection
from eskin.errors import UntrustedCertificateError
from eskin.identity import IdentityKind
from eskin.moment import SECOND
from tests.cloud.clouds import batch, count_blocks, post, problem, standing, warrant
from tests.cloud.messages import block

if TYPE_CHECKING:
    from pathlib import Path

    from tests.cloud.clouds import Stand
    from tests.identities import Identities

pytestmark = pytest.mark.anyio

BAD_CLAIMS: tuple[tuple[dict[str, Any], str], ...] = (
    ({"aud": "somebody-else"}, "udience"),
    ({"aud": None}, "aud"),
    ({"iss": "gateway.g2"}, "iss"),
    ({"iat": None}, "iat"),
    ({"exp": None}, "exp"),
    ({"jti": None}, "jti"),
    ({"sha256": None}, "sha256"),
    ({"jti": ""}, "jti"),
    ({"sha256": "0" * 64}, "another one|sha256"),
    ({"exp": 2**60}, "exp"),
    ({"exp": 10, "iat": 5}, "clock"),
    ({"iat": "now"}, "iat"),
)


@pytest.mark.parametrize(("claims", "says"), BAD_CLAIMS)
async def test_warrant_that_proves_nothing_is_refused(
    stand: Stand, claims: dict[str, Any], says: str
) -> None:
    answer = await stand.ingest(batch(block(0)), **claims)
    detail = problem(answer, 401)
    assert any(word in detail for word in says.split("|"))
    assert count_blocks(stand) == 0


async def test_warrant_for_too_long_or_outside_of_its_time_is_refused(stand: Stand) -> None:
    now = stand.clock() // SECOND
    body = batch(block(0))
    problem(await stand.ingest(body, exp=now + 61), 401)
    problem(await stand.ingest(body, iat=now + 31, exp=now + 60), 401)
    problem(await stand.ingest(body, iat=now - 91, exp=now - 31), 401)
    assert (await stand.ingest(body, iat=now + 30, exp=now + 60)).status_code == 200
    assert (await stand.ingest(body, iat=now - 89, exp=now - 29)).status_code == 200


async def test_warrant_is_good_once(stand: Stand) -> None:
    body = batch(block(0))
    assert (await stand.ingest(body, jti="once")).status_code == 200
    assert "used before" in problem(await stand.ingest(body, jti="once"), 401)


async def test_other_kinds_and_other_authorities_are_refused(
    stand: Stand, identities: Identities, tmp_path: Path
) -> None:
    from tests.identities import Identities as Fresh  # noqa: PLC0415 - the class, not the fixture

    body = batch(block(0))
    for identity in (
        identities.node,
        identities.site,
        identities.make(IdentityKind.CLIENT, "client.demo"),
        Fresh(tmp_path).gateway,
        identities.make(IdentityKind.GATEWAY, "gateway.old", lifetime=timedelta(seconds=-1)),
    ):
        token = warrant(identity, body, stand.clock())
        problem(await post(stand, body, f"Bearer {token}"), 401)
    assert count_blocks(stand) == 0


@pytest.mark.parametrize(
    "authorization",
    ["", "Basic eDp5", "Bearer", "Bearer x", "Bearer a.b.c", "Bearer " + "x" * 20_000],
)
async def test_missing_or_mangled_warrant_is_refused(stand: Stand, authorization: str) -> None:
    problem(await post(stand, batch(block(0)), authorization), 401)


async def test_deeply_nested_header_is_refused(stand: Stand) -> None:
    header = jwt.utils.base64url_encode(b'{"x5c":' + b"[" * 9000).decode()
    problem(await post(stand, b"", f"Bearer {header}.e30.e30"), 401)


async def test_symmetric_or_unsigned_warrant_is_refused(stand: Stand) -> None:
    body = batch(block(0))
    good = warrant(stand.gateway, body, stand.clock())
    header = jwt.get_unverified_header(good)
    claims = jwt.decode(good, options={"verify_signature": False})
    chain = {"x5c": header["x5c"]}
    for token in (
        jwt.encode(claims, "", algorithm="none", headers=chain),
        jwt.encode(claims, "k" * 64, algorithm="HS256", headers=chain),
        good[:-8] + "AAAAAAAA",
    ):
        problem(await post(stand, body, f"Bearer {token}"), 401)


async def test_revoked_gateway_is_refused(tmp_path: Path, identities: Identities) -> None:
    server = identities.make(IdentityKind.SERVER, "server.cloud").directory
    listed = tmp_path / "gateway.crl.pem"
    own = GatewaysSection(identity=server, revocations=listed)
    lost = identities.make(IdentityKind.GATEWAY, "gateway.lost")
    body = batch(block(0))
    with standing(tmp_path, identities, gateways=own) as stand:
        assert "cannot be read" in problem(await stand.ingest(body), 401)
        written = identities.authority.write_revocations(IdentityKind.GATEWAY)
        listed.write_bytes(written.read_bytes())
        stand.gateway = lost
        assert (await stand.ingest(body)).status_code == 200
        identities.authority.revoke("gateway.lost")
        listed.write_bytes(
            identities.authority.write_revocations(IdentityKind.GATEWAY).read_bytes()
        )
        assert "revoked" in problem(await stand.ingest(body), 401)
        stand.gateway = identities.gateway
        assert (await stand.ingest(body)).status_code == 200


def test_replay_forgets_what_expired_and_stays_small() -> None:
    replay = Replay(capacity=3)
    assert replay.first("a", until=10, now=0)
    assert not replay.first("a", until=10, now=10)
    assert replay.first("a", until=20, now=11)
    for name in "bcdefg":
        assert replay.first(name, until=30, now=12)
    assert len(replay) == 3


def test_judgement_of_a_chain_is_good_for_a_second_and_no_longer_than_its_list(
    tmp_path: Path,
) -> None:
    now = [1000.0]
    judged: list[tuple[float, list[bytes]]] = []
    leaf, revocations = Mock(), tmp_path / "list.pem"
    trust = Mock()

    def verify(chain: list[bytes], _: IdentityKind) -> Mock:
        judged.append((now[0], chain))
        return leaf

    trust.verify = verify
    revocations.write_text("one")
    keeper = Gatekeeper(trust, revocations=revocations, clock=lambda: now[0])
    for step in (0.0, 0.9, 0.1, 0.5):
        now[0] += step
        assert keeper.verify([b"leaf", b"issuer"]) is leaf
    assert [when for when, _ in judged] == [1000.0, 1001.0]
    assert keeper.verify([b"other", b"issuer"]) is leaf
    assert len(judged) == 3
    revocations.write_text("another list")
    assert keeper.verify([b"leaf", b"issuer"]) is leaf
    assert len(judged) == 4
    trust.verify = Mock(side_effect=UntrustedCertificateError("revoked"))
    for _ in range(2):
        now[0] += 1.0
        with pytest.raises(UntrustedCertificateError):
            keeper.verify([b"leaf", b"issuer"])
    assert trust.verify.call_count == 2
