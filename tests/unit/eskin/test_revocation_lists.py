"""A revocation stays, whatever becomes of the CA's clock and of its ledger."""

from __future__ import annotations

from datetime import datetime, timedelta, tzinfo
from typing import TYPE_CHECKING, ClassVar

import pytest
from cryptography import x509
from cryptography.hazmat.primitives import serialization
from eskin_ca.csr import make_request
from eskin_ca.renewal_service import RenewalService

from eskin.errors import IdentityError, UntrustedCertificateError
from eskin.identity import (
    CertificateAuthority,
    ChainVerifier,
    IdentityKind,
    crl_publisher,
    der,
    next_key,
)
from eskin.wire.envelope import sign
from eskin.wire.topics import RENEWAL
from tests.support.identities import SITE, Identities

if TYPE_CHECKING:
    from pathlib import Path

    from eskin.identity import Identity

NODE = IdentityKind.NODE
HOUR = timedelta(hours=1)


class Clock(datetime):
    """Goes wrong by ``ahead``."""

    ahead: ClassVar[timedelta] = timedelta()

    @classmethod
    def now(cls, tz: tzinfo | None = None) -> Clock:
        return super().now(tz) + cls.ahead


@pytest.fixture
def own(tmp_path: Path) -> Identities:
    return Identities(tmp_path)


def require_refused(trust: ChainVerifier, own: Identities, identity: Identity) -> None:
    trust.revocations(NODE, own.authority.revocations_file(NODE).read_bytes())
    with pytest.raises(UntrustedCertificateError, match="was revoked"):
        trust.verify([der(one) for one in identity.chain], NODE)


def test_revocation_counts_at_once_where_the_clock_was_set_back(
    own: Identities, monkeypatch: pytest.MonkeyPatch
) -> None:
    authority, trust = own.authority, ChainVerifier(*own.authority.roots)
    file = authority.revocations_file(NODE)
    monkeypatch.setattr(crl_publisher, "datetime", Clock)
    monkeypatch.setattr(Clock, "ahead", HOUR)
    authority.write_revocations(NODE)
    trust.revocations(NODE, file.read_bytes())
    wrong = x509.load_pem_x509_crl(file.read_bytes())
    monkeypatch.setattr(Clock, "ahead", timedelta())
    authority.revoke("fingertip")
    require_refused(trust, own, own.node)
    assert not authority.must_refresh(NODE)
    monkeypatch.setattr(Clock, "ahead", 2 * HOUR)
    assert authority.must_refresh(NODE), "OpenSSL would prefer the list of the wrong clock now"
    authority.refresh_revocations(NODE)
    assert x509.load_pem_x509_crl(file.read_bytes()).last_update_utc > wrong.last_update_utc
    require_refused(trust, own, own.node)
    assert not authority.must_refresh(NODE)


def test_older_list_is_refused_though_the_clock_says_that_it_is_newer(
    own: Identities, monkeypatch: pytest.MonkeyPatch
) -> None:
    trust, file = ChainVerifier(*own.authority.roots), own.authority.revocations_file(NODE)
    monkeypatch.setattr(crl_publisher, "datetime", Clock)
    monkeypatch.setattr(Clock, "ahead", HOUR)
    older = own.authority.write_revocations(NODE).read_bytes()
    monkeypatch.setattr(Clock, "ahead", timedelta())
    own.authority.revoke("fingertip")
    trust.revocations(NODE, file.read_bytes())
    with pytest.raises(UntrustedCertificateError, match="is older than the one that stands"):
        trust.revocations(NODE, older)


def test_lists_of_one_second_do_not_have_others_signed_for_ever(
    own: Identities, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(crl_publisher, "datetime", Clock)
    for _ in range(5):
        own.authority.write_revocations(NODE)
    signed = 0
    for seconds in range(1, 30):
        monkeypatch.setattr(Clock, "ahead", timedelta(seconds=seconds))
        signed += own.authority.must_refresh(NODE)
        own.authority.refresh_revocations(NODE)
    assert signed <= 1


def test_ledger_from_a_backup_forgets_no_revocation(own: Identities) -> None:
    ledger = own.ca / "ledger.jsonl"
    backup = ledger.read_bytes()
    own.authority.revoke("fingertip")
    ledger.write_bytes(backup)
    again = CertificateAuthority(own.ca)
    assert again.must_refresh(NODE)
    again.refresh_revocations(NODE)
    require_refused(ChainVerifier(*again.roots), own, own.node)
    assert again.latest("fingertip") is None
    with pytest.raises(IdentityError, match="this key was revoked"):
        again.issue(NODE, "fingertip", own.node.key.public_key(), site=SITE)


def test_certificate_that_a_ledger_from_a_backup_does_not_know_stays_revoked(
    own: Identities,
) -> None:
    ledger = own.ca / "ledger.jsonl"
    backup = ledger.read_bytes()
    palm = own.make(NODE, "palm")
    own.authority.revoke("palm")
    ledger.write_bytes(backup)
    again = CertificateAuthority(own.ca)
    again.write_revocations(NODE)
    require_refused(ChainVerifier(*again.roots), own, palm)
    request = make_request(next_key(palm.directory), "palm")
    asked = sign(request.public_bytes(serialization.Encoding.DER), own=palm, topic=RENEWAL)
    with pytest.raises(IdentityError, match="palm was revoked"):
        RenewalService(again, lifetime=HOUR, grace=HOUR).renew(asked)
