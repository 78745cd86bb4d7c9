"""Certificate requests (PKCS #10, RFC 2986): made by parties, read by the CA service."""

from __future__ import annotations

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import NameOID

from eskin.errors import IdentityError
from eskin.identity.certificates import UNREADABLE


def make_request(key: ec.EllipticCurvePrivateKey, name: str) -> x509.CertificateSigningRequest:
    """A request of a key for a common name."""
    subject = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, name)])
    return x509.CertificateSigningRequestBuilder(subject_name=subject).sign(key, hashes.SHA256())


def requested_key(request: bytes) -> ec.EllipticCurvePublicKey:
    """The key of a request (DER), which it has signed.

    Raises:
        IdentityError: It is no request, or of another kind of key.
    """
    try:
        read = x509.load_der_x509_csr(request)
        genuine, key = read.is_signature_valid, read.public_key()
    except UNREADABLE as error:
        raise IdentityError(f"no PKCS #10 request: {error}") from error
    if not genuine:
        raise IdentityError("the request is not signed by the key that it holds")
    if not isinstance(key, ec.EllipticCurvePublicKey) or not isinstance(key.curve, ec.SECP256R1):
        raise IdentityError("the requested key is not on the curve P-256")
    return key


def requested_name(request: bytes) -> str:
    """The common name of a request (DER); empty where it has none.

    Raises:
        IdentityError: It cannot be read.
    """
    try:
        names = x509.load_der_x509_csr(request).subject.get_attributes_for_oid(NameOID.COMMON_NAME)
    except UNREADABLE as error:
        raise IdentityError(f"no PKCS #10 request: {error}") from error
    return str(names[0].value) if names else ""


def der_of_pem(text: str) -> bytes:
    """A request in PEM as DER.

    Raises:
        IdentityError: It is none.
    """
    try:
        return x509.load_pem_x509_csr(text.encode()).public_bytes(serialization.Encoding.DER)
    except UNREADABLE as error:
        raise IdentityError(f"no PKCS #10 request: {error}") from error
