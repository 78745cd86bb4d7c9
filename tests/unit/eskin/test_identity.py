"""Only a chain that leads to the root over its own kind's CA is trusted."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING

import pytest

from eskin.errors import IdentityError, UntrustedCertificateError
from eskin.identity import (
    CertificateAuthority,
    ChainVerifier,
    Identity,
    IdentityKind,
    client_context,
    der,
    load_certificates,
    new_key,
    server_context,
)
from eskin.identity.certificates import leaf_certificate
from tests.support.identities import SITE

if TYPE_CHECKING:
    from pathlib import Path

    from tests.support.identities import Identities


def chain_of(identity: Identity) -> list[bytes]:
    return [der(certificate) for certificate in identity.chain]


@pytest.mark.parametrize("kind", IdentityKind)
def test_certificate_is_trusted_as_its_own_kind_only(
    identities: Identities, kind: IdentityKind
) -> None:
    name = "solo" if kind is IdentityKind.NODE else f"{kind}.solo"
    identity = identities.make(kind, name)
    trust = ChainVerifier(*identities.authority.roots)
    assert trust.verify(chain_of(identity), kind) == identity.certificate
    for other in set(IdentityKind) - {kind}:
        with pytest.raises(UntrustedCertificateError, match=f"is a {kind}, not a {other}"):
            trust.verify(chain_of(identity), other)


def test_chain_of_another_ca_is_refused(identities: Identities, tmp_path: Path) -> None:
    outsider = CertificateAuthority.open(tmp_path)
    with pytest.raises(UntrustedCertificateError, match="was not issued by our CA"):
        ChainVerifier(*outsider.roots).verify(chain_of(identities.node), IdentityKind.NODE)


def test_leaf_cannot_issue(identities: Identities) -> None:
    gateway, key = identities.gateway, new_key()
    forged = leaf_certificate(
        IdentityKind.NODE, "fingertip", key.public_key(), site=SITE, hosts=(), signer=gateway.key,
        not_before=datetime.now(UTC), lifetime=timedelta(days=1),
    )  # fmt: skip
    with pytest.raises(UntrustedCertificateError):
        ChainVerifier(*identities.authority.roots).verify(
            [der(forged), der(gateway.certificate)], IdentityKind.NODE
        )


@pytest.mark.parametrize("days", [-200, 200])
def test_certificate_outside_its_validity_is_refused(identities: Identities, days: int) -> None:
    instant = datetime.now(UTC) + timedelta(days=days)
    trust = ChainVerifier(*identities.authority.roots, clock=lambda: instant)
    with pytest.raises(UntrustedCertificateError, match="is valid from"):
        trust.verify(chain_of(identities.node), IdentityKind.NODE)


def test_revoked_certificate_is_refused(identities: Identities) -> None:
    lost = identities.make(IdentityKind.NODE, "lost")
    authority, trust = identities.authority, ChainVerifier(*identities.authority.roots)
    trust.verify(chain_of(lost), IdentityKind.NODE)
    authority.revoke("lost")
    crl = authority.write_revocations(IdentityKind.NODE)
    trust.revocations(IdentityKind.NODE, crl.read_bytes())
    with pytest.raises(UntrustedCertificateError, match="was revoked"):
        trust.verify(chain_of(lost), IdentityKind.NODE)
    trust.verify(chain_of(identities.node), IdentityKind.NODE)
    revoked = {e.name for e in authority.issued() if e.revoked}
    assert "lost" in revoked
    assert identities.node.name not in revoked


def test_revocation_list_of_another_signer_is_refused(
    identities: Identities, tmp_path: Path
) -> None:
    crl = CertificateAuthority.open(tmp_path).write_revocations(IdentityKind.NODE).read_bytes()
    trust = ChainVerifier(*identities.authority.roots)
    with pytest.raises(UntrustedCertificateError, match="not issued by our CA"):
        trust.revocations(IdentityKind.NODE, crl)


@pytest.mark.parametrize("chain", [[], [b""], [b"x", b"y"], [b"x"] * 3])
def test_what_is_no_chain_is_refused(identities: Identities, chain: list[bytes]) -> None:
    with pytest.raises(UntrustedCertificateError):
        ChainVerifier(*identities.authority.roots).verify(chain, IdentityKind.NODE)


@pytest.mark.parametrize(
    ("kind", "name"),
    [
        (IdentityKind.NODE, "gateway.g1"),
        (IdentityKind.NODE, "Finger"),
        (IdentityKind.NODE, "a/b"),
        (IdentityKind.NODE, ""),
        (IdentityKind.GATEWAY, "g1"),
        (IdentityKind.GATEWAY, "client.g1"),
        (IdentityKind.CLIENT, "client."),
    ],
)
def test_name_of_another_kind_is_not_issued(
    identities: Identities, kind: IdentityKind, name: str
) -> None:
    with pytest.raises(IdentityError, match=f"no name of a {kind}"):
        identities.authority.issue(kind, name, new_key().public_key(), site=SITE)


def test_anchor_of_a_kind_signs_itself(identities: Identities) -> None:
    anchor = load_certificates(identities.authority.anchor_file(IdentityKind.NODE))[0]
    anchor.verify_directly_issued_by(anchor)
    identities.node.certificate.verify_directly_issued_by(anchor)


def test_key_that_others_may_read_is_refused(identities: Identities) -> None:
    careless = identities.make(IdentityKind.NODE, "careless")
    (careless.directory / "key.pem").chmod(0o640)
    with pytest.raises(IdentityError, match="chmod 600"):
        Identity.load(careless.directory)


@pytest.mark.parametrize("name", ["key.pem", "chain.pem", "root.pem"])
def test_missing_file_is_named_once_with_the_command_that_makes_it(
    identities: Identities, name: str
) -> None:
    folder = identities.make(IdentityKind.NODE, f"no-{name[:-4]}").directory
    (folder / name).unlink()
    with pytest.raises(IdentityError, match="eskin pki issue") as caught:
        Identity.load(folder)
    assert str(caught.value).startswith(f"{folder / name}: ")
    assert str(caught.value).count(name) == 1


def test_key_of_another_certificate_is_refused(identities: Identities) -> None:
    mixed = identities.make(IdentityKind.NODE, "mixed")
    (mixed.directory / "chain.pem").write_bytes(
        (identities.node.directory / "chain.pem").read_bytes()
    )
    with pytest.raises(IdentityError, match="does not belong to"):
        Identity.load(mixed.directory)


def test_tls_contexts_always_check_and_never_speak_below_1_2(identities: Identities) -> None:
    server = identities.make(IdentityKind.SERVER, "server.tls")
    client = client_context(server.directory / "root.pem", identities.node)
    assert client.check_hostname
    both = [client, server_context(server.directory, client_certificates=True)]
    assert [context.verify_mode.name for context in both] == ["CERT_REQUIRED"] * 2
    assert [context.minimum_version.name for context in both] == ["TLSv1_2"] * 2


def test_older_or_overdue_revocation_list_is_refused(identities: Identities) -> None:
    present = datetime.now(UTC)
    instant = [present]
    trust = ChainVerifier(*identities.authority.roots, clock=lambda: instant[0])
    file = identities.authority.revocations_file(IdentityKind.NODE)
    older = file.read_bytes()
    identities.make(IdentityKind.NODE, "elder")
    identities.authority.revoke("elder")
    trust.revocations(IdentityKind.NODE, file.read_bytes())
    with pytest.raises(UntrustedCertificateError, match="older than the one that stands"):
        trust.revocations(IdentityKind.NODE, older)
    trust.verify(chain_of(identities.node), IdentityKind.NODE)
    instant[0] = present + timedelta(days=8)
    with pytest.raises(UntrustedCertificateError, match="should have been renewed"):
        trust.verify(chain_of(identities.node), IdentityKind.NODE)
