"""Issuing CAs are replaced with an overlap."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from eskin.errors import IdentityError, UntrustedCertificateError
from eskin.identity import CertificateAuthority, ChainVerifier, IdentityKind, der, load_certificates
from tests.support.identities import SITE, Identities

if TYPE_CHECKING:
    from pathlib import Path

    from eskin.identity import Identity

NODE = IdentityKind.NODE


def chain_of(identity: Identity) -> list[bytes]:
    return [der(certificate) for certificate in identity.chain]


def test_both_cas_pass_until_the_old_one_is_retired(tmp_path: Path) -> None:
    own = Identities(tmp_path)
    authority, trust = own.authority, ChainVerifier(*own.authority.roots)
    authority.rotate(NODE)
    new = own.make(NODE, "palm")
    trust.revocations(NODE, authority.revocations_file(NODE).read_bytes())
    for identity in (own.node, new):
        trust.verify(chain_of(identity), NODE)
        assert trust.issuer_of(identity.certificate, NODE) == identity.chain[1]
    assert len(load_certificates(authority.anchor_file(NODE))) == 2
    assert authority.dependants(NODE) == ["fingertip"]
    authority.retire(NODE)
    trust.revocations(NODE, authority.revocations_file(NODE).read_bytes())
    trust.verify(chain_of(new), NODE)
    with pytest.raises(UntrustedCertificateError, match="does not stand any more"):
        trust.verify(chain_of(own.node), NODE)
    (anchor,) = load_certificates(authority.anchor_file(NODE))
    assert anchor.public_key() == new.chain[1].public_key()
    assert len(list(own.ca.glob("node*key"))) == 1


def test_each_ca_revokes_what_it_issued(tmp_path: Path) -> None:
    own = Identities(tmp_path)
    authority, trust = own.authority, ChainVerifier(*own.authority.roots)
    authority.rotate(NODE)
    new = own.make(NODE, "palm")
    for name in ("fingertip", "palm"):
        authority.revoke(name)
    trust.revocations(NODE, authority.revocations_file(NODE).read_bytes())
    for identity in (own.node, new):
        with pytest.raises(UntrustedCertificateError, match="was revoked"):
            trust.verify(chain_of(identity), NODE)


def test_ca_is_rotated_once_at_a_time_and_survives_reopening(tmp_path: Path) -> None:
    own = Identities(tmp_path)
    with pytest.raises(IdentityError, match="no node CA is being replaced"):
        own.authority.retire(NODE)
    own.authority.rotate(NODE)
    with pytest.raises(IdentityError, match="being replaced already"):
        own.authority.rotate(NODE)
    chain = CertificateAuthority(own.ca).issue(NODE, "palm", own.node.key.public_key(), site=SITE)
    assert chain[1] == load_certificates(own.ca / "node.pem")[0]
    (own.ca / "node.key").unlink()
    with pytest.raises(IdentityError, match="key of a node CA is missing"):
        CertificateAuthority(own.ca)
