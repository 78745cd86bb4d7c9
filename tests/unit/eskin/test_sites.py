"""Sites in certificates: a node or gateway belongs to one, by its CA's word, for good."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING

import pytest
from cryptography import x509

from eskin.errors import IdentityError, UntrustedCertificateError
from eskin.identity import ChainVerifier, IdentityKind, der, new_key, site_of
from eskin.identity import certificates as made
from eskin.identity.issuing_ca import load_issuers
from tests.support.identities import SITE

if TYPE_CHECKING:
    from tests.support.identities import Identities

OTHER = "site.other"


def test_certificates_of_nodes_and_gateways_name_their_site(identities: Identities) -> None:
    for kind, name in ((IdentityKind.NODE, "toe"), (IdentityKind.GATEWAY, "gateway.toe")):
        own = identities.make(kind, name, site=OTHER)
        assert site_of(own.certificate) == own.site == OTHER
        names = own.certificate.extensions.get_extension_for_class(x509.SubjectAlternativeName)
        uris = names.value.get_values_for_type(x509.UniformResourceIdentifier)
        assert uris == [f"spiffe://eskin/{OTHER}/{name}"]


@pytest.mark.parametrize("kind", [IdentityKind.NODE, IdentityKind.GATEWAY])
@pytest.mark.parametrize("site", ["", "main", "gateway.g1", "site.a/b", "Site.a"])
def test_none_is_issued_without_a_site(
    identities: Identities, kind: IdentityKind, site: str
) -> None:
    name = "nail" if kind is IdentityKind.NODE else "gateway.nail"
    with pytest.raises(IdentityError):
        identities.authority.issue(kind, name, new_key().public_key(), site=site)
    assert name not in {entry.name for entry in identities.authority.issued()}


def test_other_kinds_have_no_site(identities: Identities) -> None:
    for kind in (IdentityKind.SITE, IdentityKind.SERVER, IdentityKind.CLIENT):
        own = identities.make(kind, f"{kind}.alone")
        with pytest.raises(IdentityError):
            site_of(own.certificate)
        with pytest.raises(IdentityError):
            identities.authority.issue(kind, own.name, new_key().public_key(), site=SITE)


def test_name_belongs_to_one_site_also_after_its_revocation(identities: Identities) -> None:
    authority = identities.authority
    identities.make(IdentityKind.NODE, "wanderer", site=SITE)
    for _ in range(2):
        with pytest.raises(IdentityError, match=SITE):
            authority.issue(IdentityKind.NODE, "wanderer", new_key().public_key(), site=OTHER)
        authority.revoke("wanderer")
    authority.issue(IdentityKind.NODE, "wanderer", new_key().public_key(), site=SITE)


@pytest.mark.parametrize(
    "uris",
    [
        [],
        ["urn:eskin:node:bare"],
        ["spiffe://eskin/bare"],
        [f"spiffe://eskin/{SITE}/another"],
        [f"spiffe://other/{SITE}/bare"],
        [f"spiffe://eskin/{SITE}/bare", f"spiffe://eskin/{OTHER}/bare"],
        [f"spiffe://eskin/{SITE}/x/bare"],
    ],
)
def test_certificate_that_names_no_site_is_trusted_nowhere(
    identities: Identities, monkeypatch: pytest.MonkeyPatch, uris: list[str]
) -> None:
    issuer = load_issuers(identities.ca, IdentityKind.NODE)[0]
    names = x509.SubjectAlternativeName(
        [x509.DNSName("bare"), *map(x509.UniformResourceIdentifier, uris)]
    )
    monkeypatch.setattr(made, "_alternative_names", lambda *_: names)
    leaf = made.leaf_certificate(
        IdentityKind.NODE,
        "bare",
        new_key().public_key(),
        site=SITE,
        hosts=(),
        signer=issuer.key,
        not_before=datetime.now(UTC),
        lifetime=timedelta(days=1),
    )
    with pytest.raises(UntrustedCertificateError):
        ChainVerifier(*identities.authority.roots).verify(
            [der(leaf), der(issuer.certificate)], IdentityKind.NODE
        )
