"""Which certificates are of gateways of ours, at each request."""

from __future__ import annotations

from datetime import timedelta
from typing import TYPE_CHECKING
from unittest.mock import Mock

import pytest
from eskin_cloud.ingest.gateway_trust import GatewayTrust
from eskin_cloud.settings import GatewaysSection

from eskin.errors import UntrustedCertificateError
from eskin.identity import ChainVerifier, IdentityKind, der
from tests.unit.cloud.clouds import batch, count_frames, problem, standing
from tests.unit.cloud.messages import stretch

if TYPE_CHECKING:
    from pathlib import Path

    from tests.support.identities import Identities
    from tests.unit.cloud.clouds import Stand

pytestmark = pytest.mark.anyio


async def test_other_kinds_and_other_authorities_are_refused(
    stand: Stand, identities: Identities, tmp_path: Path
) -> None:
    from tests.support.identities import Identities as Fresh  # noqa: PLC0415 - the class, not the fixture

    body = batch(stretch(0))
    for identity in (
        None,
        identities.node,
        identities.site,
        identities.make(IdentityKind.CLIENT, "client.demo"),
        Fresh(tmp_path).gateway,
        identities.make(IdentityKind.GATEWAY, "gateway.old", lifetime=timedelta(seconds=-1)),
    ):
        stand.gateway = identity
        answer = await stand.ingest(body)
        problem(answer, 403)
        assert answer.headers["connection"] == "close"
    assert count_frames(stand) == 0


async def test_revoked_gateway_is_refused(tmp_path: Path, identities: Identities) -> None:
    server = identities.make(IdentityKind.SERVER, "server.cloud").directory
    listed = tmp_path / "gateway.crl.pem"
    own = GatewaysSection(identity=server, revocations=listed)
    lost = identities.make(IdentityKind.GATEWAY, "gateway.lost")
    body = batch(stretch(0))
    with standing(tmp_path, identities, gateways=own) as stand:
        assert "cannot be read" in problem(await stand.ingest(body), 403)
        written = identities.authority.write_revocations(IdentityKind.GATEWAY)
        listed.write_bytes(written.read_bytes())
        stand.gateway = lost
        assert (await stand.ingest(body)).status_code == 200
        identities.authority.revoke("gateway.lost")
        listed.write_bytes(
            identities.authority.write_revocations(IdentityKind.GATEWAY).read_bytes()
        )
        assert "revoked" in problem(await stand.ingest(body), 403)
        stand.gateway = identities.gateway
        assert (await stand.ingest(body)).status_code == 200


def test_last_good_revocation_list_stays_where_another_cannot_be_used(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    from tests.support.identities import Identities as Fresh  # noqa: PLC0415 - the class, not the fixture

    own, now, listed = Fresh(tmp_path / "own"), [1000.0], tmp_path / "gateway.crl.pem"
    lost = own.make(IdentityKind.GATEWAY, "gateway.lost")
    good, revoked = ([der(one) for one in who.chain] for who in (own.gateway, lost))
    renewal_agent = GatewayTrust(
        ChainVerifier(*own.authority.roots), gateways=listed, clock=lambda: now[0]
    )

    def put_down(data: bytes | None) -> None:
        now[0] += 5
        listed.unlink(missing_ok=True)
        if data is not None:
            listed.write_bytes(data)

    older = own.authority.revocations_file(IdentityKind.GATEWAY).read_bytes()
    nodes = own.authority.revocations_file(IdentityKind.NODE).read_bytes()
    bad = {b"rubbish": "no revocation list", nodes: "is no gateway CA"}
    for data, words in bad.items():
        put_down(data)
        for _ in range(2):
            with pytest.raises(UntrustedCertificateError, match=words):
                renewal_agent.verify(good)
    own.authority.revoke("gateway.lost")
    put_down(own.authority.revocations_file(IdentityKind.GATEWAY).read_bytes())
    renewal_agent.verify(good)
    caplog.clear()
    for changed in (*bad, older, None):
        put_down(changed)
        for _ in range(3):
            now[0] += 2
            renewal_agent.verify(good)
            with pytest.raises(UntrustedCertificateError, match="was revoked"):
                renewal_agent.verify(revoked)
    warnings = [record for record in caplog.records if record.levelname == "WARNING"]
    assert len(warnings) == len([*bad, older, None]), "each once"
    put_down(own.authority.write_revocations(IdentityKind.GATEWAY).read_bytes())
    renewal_agent.verify(good)


def test_list_that_comes_before_its_root_is_taken_once_that_has_come(tmp_path: Path) -> None:
    now, listed = [1000.0], tmp_path / "list.pem"
    trust = Mock()
    trust.revocations = Mock(side_effect=UntrustedCertificateError("not issued by our CA"))
    renewal_agent = GatewayTrust(trust, gateways=listed, clock=lambda: now[0])
    listed.write_text("one")
    for _ in range(3):
        with pytest.raises(UntrustedCertificateError, match="not issued by our CA"):
            renewal_agent.verify([b"leaf", b"issuer"])
    assert trust.revocations.call_count == 1, "it is read again for each request"
    trust.revocations = Mock()
    now[0] += 1.0
    renewal_agent.verify([b"leaf", b"issuer"])
    assert trust.revocations.call_count == 1


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
    renewal_agent = GatewayTrust(trust, gateways=revocations, clock=lambda: now[0])
    for step in (0.0, 0.9, 0.1, 0.5):
        now[0] += step
        assert renewal_agent.verify([b"leaf", b"issuer"]) is leaf
    assert [when for when, _ in judged] == [1000.0, 1001.0]
    assert renewal_agent.verify([b"other", b"issuer"]) is leaf
    assert len(judged) == 3
    revocations.write_text("another list")
    assert renewal_agent.verify([b"leaf", b"issuer"]) is leaf
    assert len(judged) == 4
    trust.verify = Mock(side_effect=UntrustedCertificateError("revoked"))
    for _ in range(2):
        now[0] += 1.0
        with pytest.raises(UntrustedCertificateError):
            renewal_agent.verify([b"leaf", b"issuer"])
    assert trust.verify.call_count == 2
