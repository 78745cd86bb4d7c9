"""Reading revocation lists: certificates of issuing CAs, and what each of them signed."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from cryptography import x509

from eskin.errors import IdentityError, UntrustedCertificateError
from eskin.identity.certificates import (
    UNREADABLE,
    common_name,
    der,
    public_key,
    read_certificate,
    thumbprint,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from datetime import datetime

_LIST: Final = re.compile(b"-----BEGIN X509 CRL-----.+?-----END X509 CRL-----\n?", re.DOTALL)


@dataclass(frozen=True, slots=True)
class Listed:
    """One issuing CA's revocation list.

    Attributes:
        issuer: Its certificate.
        revocations: The list.
        expires: When another one should have come.
    """

    issuer: x509.Certificate
    revocations: x509.CertificateRevocationList
    expires: datetime


Lists = dict[bytes, Listed]
"""Lists of one kind, by the thumbprint of the issuing CA's certificate."""


def read_lists(
    data: bytes, standing: Mapping[bytes, Listed], require: Callable[[x509.Certificate], None]
) -> Lists:
    """Read and check the lists of one kind.

    Args:
        data: PEM.
        standing: What it replaces; none of these may be newer.
        require: Raises for a certificate that is no issuing CA of that kind.

    Raises:
        UntrustedCertificateError: Something is wrong with it; nothing of it is taken.
    """
    try:
        issuers = [read_certificate(der(one)) for one in x509.load_pem_x509_certificates(data)]
        found = [x509.load_pem_x509_crl(part) for part in _LIST.findall(data)]
        # Parsed when asked for, and no sooner.
        _ = [(one.next_update_utc, one.last_update_utc, one.extensions) for one in found]
    except (IdentityError, *UNREADABLE) as error:
        raise UntrustedCertificateError(f"no revocation list: {error}") from error
    lists: Lists = {}
    for issuer in issuers:
        require(issuer)
        listed = _signed_by(issuer, found)
        before = standing.get(thumbprint(issuer))
        if before is not None and _number(listed) < _number(before):
            raise UntrustedCertificateError(
                f"the revocation list of {common_name(issuer)!r} is older than the one that stands"
            )
        lists[thumbprint(issuer)] = listed
    return lists


def number_of(one: x509.CertificateRevocationList) -> int:
    """A list's place among those of its issuer (RFC 5280, section 5.2.3), whatever the clock says.

    One from before lists had numbers has the second in which it was signed: see
    `eskin.identity.crl_publisher`.
    """
    try:
        return one.extensions.get_extension_for_class(x509.CRLNumber).value.crl_number
    except x509.ExtensionNotFound:
        return int(one.last_update_utc.timestamp())


def revoked_certificates(data: bytes) -> dict[str, x509.RevokedCertificate]:
    """All that lists (PEM) revoke, which were checked before, by hexadecimal serial number."""
    lists = [x509.load_pem_x509_crl(part) for part in _LIST.findall(data)]
    return {f"{entry.serial_number:x}": entry for one in lists for entry in one}


def revoked_serials(data: bytes) -> set[str]:
    """Serial numbers of these."""
    return set(revoked_certificates(data))


def _signed_by(issuer: x509.Certificate, found: list[x509.CertificateRevocationList]) -> Listed:
    for listed in found:
        expires = listed.next_update_utc
        if listed.is_signature_valid(public_key(issuer)) and expires is not None:
            return Listed(issuer, listed, expires)
    raise UntrustedCertificateError("the revocation list is not signed by its issuer")


def _number(listed: Listed) -> int:
    return number_of(listed.revocations)
