"""Certificates and requests that outsiders bring: to the CA, and in chains and lists."""

from __future__ import annotations

from datetime import timedelta
from typing import TYPE_CHECKING, Any

import cbor2
from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec, ed25519, rsa
from eskin_ca.csr import der_of_pem, make_request, requested_key
from eskin_ca.renewal_service import RenewalService

from eskin.errors import IdentityError
from eskin.identity import ChainVerifier, IdentityKind, der, new_key
from eskin.wire.envelope import sign
from eskin.wire.topics import RENEWAL
from tests.robustness.fuzz.mutations.trees import mutate_tree, read_input
from tests.robustness.fuzz.target import Target
from tests.support.identities import Identities

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from cryptography.hazmat.primitives.asymmetric.types import CertificateIssuerPrivateKeyTypes


class _Nothing:
    """Of which nothing is."""


def make(folder: Path) -> Target:
    """The input is ``[what, content]``; only `IdentityError`."""
    identities = Identities(folder / "identities")
    authority, node = identities.authority, identities.node
    days = timedelta(days=30)
    renewals = RenewalService(authority, lifetime=days, grace=days)
    trust = ChainVerifier(*authority.roots)
    crl = authority.write_revocations(IdentityKind.NODE).read_bytes()

    def verify(content: Any) -> object:
        return trust.verify([part for part in content if isinstance(part, bytes)], node.kind)

    def revocations(content: Any) -> None:
        ChainVerifier(*authority.roots).revocations(IdentityKind.NODE, bytes(content))

    ways: dict[str, tuple[type, Callable[[Any], object]]] = {
        "request": (bytes, requested_key),
        "pem": (str, lambda text: requested_key(der_of_pem(text))),
        "chain": (list, verify),
        "list": (bytes, revocations),
        "renewal": (bytes, renewals.renew),
    }

    def check(data: bytes) -> None:
        what, content = read_input(data, 2)
        kind, read = ways.get(what, (_Nothing, requested_key))
        if isinstance(content, kind):
            try:
                read(content)
            except IdentityError:
                return

    asked = make_request(new_key(), "fingertip")
    inputs = [
        *(["request", request] for request in _requests()),
        ["pem", asked.public_bytes(serialization.Encoding.PEM).decode()],
        ["chain", [der(certificate) for certificate in node.chain]],
        ["chain", [der(certificate) for certificate in identities.gateway.chain]],
        ["chain", [der(authority.roots[0]), der(authority.roots[0])]],
        ["list", crl],
        ["renewal", sign(_requests()[0], own=node, topic=RENEWAL)],
    ]
    return Target(tuple(cbor2.dumps(one) for one in inputs), mutate_tree, check)


def _requests() -> list[bytes]:
    """Of each kind of key, most of which are refused."""
    keys: list[CertificateIssuerPrivateKeyTypes] = [
        new_key(),
        ec.generate_private_key(ec.SECP384R1()),
        rsa.generate_private_key(65537, 2048),
        ed25519.Ed25519PrivateKey.generate(),
    ]
    builder = x509.CertificateSigningRequestBuilder(x509.Name([]))
    return [
        builder.sign(
            key, None if isinstance(key, ed25519.Ed25519PrivateKey) else hashes.SHA256()
        ).public_bytes(serialization.Encoding.DER)
        for key in keys
    ]
