"""X.509 certificates as eskin makes and reads them (RFC 5280; EC P-256, SHA-256)."""

from __future__ import annotations

import hashlib
from datetime import timedelta
from ipaddress import ip_address
from typing import TYPE_CHECKING, Final

from cryptography import x509
from cryptography.exceptions import UnsupportedAlgorithm
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from eskin.errors import IdentityError
from eskin.identity.identity_kind import IdentityKind

if TYPE_CHECKING:
    from collections.abc import Sequence
    from datetime import datetime

SKEW: Final = timedelta(minutes=5)
"""Certificates are valid from a little before they are made, for clocks that are behind."""

UNREADABLE: Final = (
    ValueError,
    TypeError,
    UnsupportedAlgorithm,
    x509.DuplicateExtension,
    x509.InvalidVersion,
    x509.UnsupportedGeneralNameType,
)
"""Errors of reading an untrusted certificate or request."""

_TRUST_DOMAIN: Final = "spiffe://eskin/"
"""What all SPIFFE IDs of one CA begin with."""

_NO_USAGE: Final = {
    "digital_signature": False,
    "content_commitment": False,
    "key_encipherment": False,
    "data_encipherment": False,
    "key_agreement": False,
    "key_cert_sign": False,
    "crl_sign": False,
    "encipher_only": False,
    "decipher_only": False,
}


def new_key() -> ec.EllipticCurvePrivateKey:
    """A fresh P-256 key from the operating system's generator."""
    return ec.generate_private_key(ec.SECP256R1())


def read_certificate(data: bytes) -> x509.Certificate:
    """Read an untrusted certificate (DER).

    Raises:
        IdentityError: It is none, or a field of it cannot be read.
    """
    try:
        found = x509.load_der_x509_certificate(data)
        # These fields are parsed lazily: check them now, so that later reads cannot fail.
        _ = found.subject, found.issuer, found.not_valid_before_utc, found.not_valid_after_utc
        _ = found.extensions, found.public_key(), found.signature_hash_algorithm
    except UNREADABLE as error:
        raise IdentityError(f"no certificate that can be read: {error}") from error
    return found


def thumbprint(certificate: x509.Certificate) -> bytes:
    """SHA-256 of the DER: the certificate's name in envelopes (RFC 9360, x5t)."""
    return certificate.fingerprint(hashes.SHA256())


def key_digest(key: ec.EllipticCurvePublicKey) -> str:
    """SHA-256 of a public key (SubjectPublicKeyInfo, DER), hexadecimal."""
    data = key.public_bytes(
        serialization.Encoding.DER, serialization.PublicFormat.SubjectPublicKeyInfo
    )
    return hashlib.sha256(data).hexdigest()


def common_name(certificate: x509.Certificate) -> str:
    """The subject's common name.

    Raises:
        IdentityError: There is not exactly one.
    """
    return _only_name(certificate.subject)


def issuer_kind(certificate: x509.Certificate) -> IdentityKind:
    """The kind whose issuing CA the certificate names.

    This is proof only after the chain was verified: issuing CAs may issue no CA, so the name is
    then the root's word.

    Raises:
        IdentityError: The issuer is no issuing CA of eskin.
    """
    issuer = _only_name(certificate.issuer)
    for kind in IdentityKind:
        if kind.issuer == issuer:
            return kind
    raise IdentityError(f"issuer {issuer!r} is no issuing CA of eskin")


def site_of(certificate: x509.Certificate) -> str:
    """The site of a node or gateway, as its CA says: the common name of the site, ``site.main``.

    It stands in the one URI of the subject alternative name, a SPIFFE ID
    ``spiffe://eskin/SITE/NAME``; this is proof only after the chain was verified.

    Raises:
        IdentityError: It names none, another than the one name, or the kind has no site.
    """
    kind, name = issuer_kind(certificate), common_name(certificate)
    if not kind.has_site:
        raise IdentityError(f"{name} is a {kind}, which belongs to no site")
    try:
        names = certificate.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
        uris = names.get_values_for_type(x509.UniformResourceIdentifier)
    except (x509.ExtensionNotFound, *UNREADABLE) as error:
        raise IdentityError(f"the certificate of {name} names no site: {error}") from error
    site = uris[0].removeprefix(_TRUST_DOMAIN).partition("/")[0] if len(uris) == 1 else ""
    if not site or uris[0] != spiffe_id(name, kind.require_site(site)):
        raise IdentityError(f"the certificate of {name} names no site; have it issued anew")
    return site


def spiffe_id(name: str, site: str) -> str:
    """The SPIFFE ID of an identity: its common name below its site's, if it has one."""
    return f"{_TRUST_DOMAIN}{site}/{name}" if site else f"{_TRUST_DOMAIN}{name}"


def ca_certificate(
    subject: str,
    key: ec.EllipticCurvePublicKey,
    *,
    issuer: str,
    signer: ec.EllipticCurvePrivateKey,
    path_length: int | None,
    not_before: datetime,
    lifetime: timedelta,
) -> x509.Certificate:
    """Make a CA's certificate."""
    usage = x509.KeyUsage(**_NO_USAGE | {"key_cert_sign": True, "crl_sign": True})
    builder = _builder(subject, issuer, key, not_before, lifetime)
    builder = builder.add_extension(
        x509.BasicConstraints(ca=True, path_length=path_length), critical=True
    )
    builder = builder.add_extension(usage, critical=True)
    return _signed(builder, key, signer)


def leaf_certificate(
    kind: IdentityKind,
    name: str,
    key: ec.EllipticCurvePublicKey,
    *,
    site: str,
    hosts: Sequence[str],
    signer: ec.EllipticCurvePrivateKey,
    not_before: datetime,
    lifetime: timedelta,
) -> x509.Certificate:
    """Make the certificate of an identity."""
    builder = _builder(name, kind.issuer, key, not_before, lifetime)
    builder = builder.add_extension(
        x509.BasicConstraints(ca=False, path_length=None), critical=True
    )
    builder = builder.add_extension(_usage(kind), critical=True)
    builder = builder.add_extension(x509.ExtendedKeyUsage([_purpose(kind)]), critical=False)
    builder = builder.add_extension(_alternative_names(name, site, hosts), critical=False)
    return _signed(builder, key, signer)


def pem(certificates: Sequence[x509.Certificate]) -> bytes:
    """Write certificates one after another as PEM."""
    return b"".join(c.public_bytes(serialization.Encoding.PEM) for c in certificates)


def der(certificate: x509.Certificate) -> bytes:
    """Write a certificate as DER."""
    return certificate.public_bytes(serialization.Encoding.DER)


def public_key(certificate: x509.Certificate) -> ec.EllipticCurvePublicKey:
    """The subject's P-256 key.

    Raises:
        IdentityError: It is a key of another kind.
    """
    key = certificate.public_key()
    if not isinstance(key, ec.EllipticCurvePublicKey) or not isinstance(key.curve, ec.SECP256R1):
        raise IdentityError("the certificate's key is not on the curve P-256")
    return key


def _only_name(name: x509.Name) -> str:
    found = name.get_attributes_for_oid(NameOID.COMMON_NAME)
    if len(found) != 1 or not isinstance(found[0].value, str):
        raise IdentityError(f"{name.rfc4514_string()!r} does not have exactly one common name")
    return found[0].value


def _builder(
    subject: str,
    issuer: str,
    key: ec.EllipticCurvePublicKey,
    not_before: datetime,
    lifetime: timedelta,
) -> x509.CertificateBuilder:
    return x509.CertificateBuilder(
        issuer_name=x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, issuer)]),
        subject_name=x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, subject)]),
        public_key=key,
        serial_number=x509.random_serial_number(),
        not_valid_before=not_before - SKEW,
        not_valid_after=not_before + lifetime,
    )


def _signed(
    builder: x509.CertificateBuilder,
    key: ec.EllipticCurvePublicKey,
    signer: ec.EllipticCurvePrivateKey,
) -> x509.Certificate:
    builder = builder.add_extension(x509.SubjectKeyIdentifier.from_public_key(key), critical=False)
    builder = builder.add_extension(
        x509.AuthorityKeyIdentifier.from_issuer_public_key(signer.public_key()), critical=False
    )
    return builder.sign(signer, hashes.SHA256())


def _usage(kind: IdentityKind) -> x509.KeyUsage:
    # Nodes and sites agree on keys for envelopes; all but sites sign TLS handshakes.
    agrees = kind in {IdentityKind.NODE, IdentityKind.SITE}
    signs = kind is not IdentityKind.SITE
    return x509.KeyUsage(**_NO_USAGE | {"digital_signature": signs, "key_agreement": agrees})


def _purpose(kind: IdentityKind) -> x509.ObjectIdentifier:
    if kind is IdentityKind.SERVER:
        return ExtendedKeyUsageOID.SERVER_AUTH
    if kind is IdentityKind.SITE:
        # Neither side of TLS: RFC 5280 purposes of our own are named under the UUID arc.
        return x509.ObjectIdentifier("2.25.291871734817354861")
    return ExtendedKeyUsageOID.CLIENT_AUTH


def _alternative_names(name: str, site: str, hosts: Sequence[str]) -> x509.SubjectAlternativeName:
    names: list[x509.GeneralName] = [x509.UniformResourceIdentifier(spiffe_id(name, site))]
    for host in hosts:
        try:
            names.append(x509.IPAddress(ip_address(host)))
        except ValueError:
            names.append(x509.DNSName(host))
    return x509.SubjectAlternativeName(names)
