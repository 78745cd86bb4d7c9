"""The embedded broker's client_auth reads the CA's revocation lists while it runs."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from cryptography.hazmat.primitives.serialization import Encoding

from eskin.demo.broker.client_auth import ClientAuth
from eskin.errors import IdentityError, UntrustedCertificateError
from eskin.identity import IdentityKind
from tests.support.identities import Identities

if TYPE_CHECKING:
    from pathlib import Path

    from eskin.identity import Identity


def der(identity: Identity) -> bytes:
    return identity.certificate.public_bytes(Encoding.DER)


def test_revoked_certificate_is_refused_and_a_broken_list_changes_nothing(tmp_path: Path) -> None:
    own = Identities(tmp_path)
    client_auth = ClientAuth(own.ca)
    assert client_auth.admit(der(own.node)).name == "fingertip"
    assert not client_auth.refresh()
    own.authority.revoke("fingertip")
    assert client_auth.refresh()
    with pytest.raises(UntrustedCertificateError, match="revoked"):
        client_auth.admit(der(own.node))
    assert client_auth.admit(der(own.gateway)).kind is IdentityKind.GATEWAY
    listed = own.authority.revocations_file(IdentityKind.NODE)
    foreign = Identities(tmp_path / "foreign").authority.revocations_file(IdentityKind.NODE)
    for bad in (listed.read_bytes()[:100], foreign.read_bytes()):
        listed.write_bytes(bad)
        assert not client_auth.refresh()
        with pytest.raises(UntrustedCertificateError, match="revoked"):
            client_auth.admit(der(own.node))
    again = own.make(IdentityKind.NODE, "fingertip")
    assert client_auth.admit(der(again)).name == "fingertip"


def test_certificate_of_another_ca_or_none_is_refused(tmp_path: Path) -> None:
    own, foreign = Identities(tmp_path), Identities(tmp_path / "foreign")
    client_auth = ClientAuth(own.ca)
    for shown in (None, b"", der(foreign.node)):
        with pytest.raises(IdentityError):
            client_auth.admit(shown)


def test_missing_list_lets_no_client_start(tmp_path: Path) -> None:
    own = Identities(tmp_path)
    own.authority.revocations_file(IdentityKind.CLIENT).unlink()
    with pytest.raises(UntrustedCertificateError, match=r"client\.crl\.pem"):
        ClientAuth(own.ca)
