"""Deciding whether a certificate chain is what it says."""

from __future__ import annotations

import logging
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Self

from cryptography import x509
from cryptography.exceptions import InvalidSignature

from eskin.errors import IdentityError, UntrustedCertificateError
from eskin.identity.certificates import (
    common_name,
    issuer_kind,
    public_key,
    read_certificate,
    site_of,
    thumbprint,
)
from eskin.identity.crl import read_lists
from eskin.identity.identity import load_certificates
from eskin.identity.roots import is_issued_by
from eskin.runtime.files.stamp import version

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from eskin.identity.crl import Lists
    from eskin.identity.identity_kind import IdentityKind
    from eskin.runtime.files.stamp import Version

log = logging.getLogger(__name__)


class ChainVerifier:
    """Verifies chains against roots, and against revocation lists.

    Args:
        roots: The root CAs' certificates.
        clock: Gives the present; passed in so that tests can turn it.
    """

    def __init__(
        self,
        *roots: x509.Certificate,
        clock: Callable[[], datetime] = lambda: datetime.now(UTC),
    ) -> None:
        self._roots: Sequence[x509.Certificate] = roots
        self._clock = clock
        self._lists: dict[IdentityKind, Lists] = {}
        self._file: Path | None = None
        self._seen: Version | None = None
        # Of issuing CAs, by thumbprint: what verified once needs no second look at its signature.
        self._led: dict[bytes, x509.Certificate] = {}

    @classmethod
    def following(
        cls, file: Path, *, clock: Callable[[], datetime] = lambda: datetime.now(UTC)
    ) -> Self:
        """Trust in the roots of a file (PEM), which may be replaced at any time.

        Where it cannot be read, those that were read last stay.

        Raises:
            IdentityError: It cannot be read now.
        """
        verifier = cls(*load_certificates(file), clock=clock)
        verifier._file = file
        return verifier

    def revocations(self, kind: IdentityKind, data: bytes) -> None:
        """Load a kind's revocation list; from then on that kind requires one.

        Args:
            kind: The kind of its subject.
            data: PEM: certificates of issuing CAs, and for each the list that it signed.

        Raises:
            UntrustedCertificateError: It is no list, not signed by an issuing CA of that kind, or
                older than the one that stands.
        """
        self._follow()
        self._lists[kind] = read_lists(
            data, self._lists.get(kind, {}), lambda issuer: self._require_issuing(issuer, kind)
        )

    def issuer_of(self, leaf: x509.Certificate, kind: IdentityKind) -> x509.Certificate:
        """The issuing CA of a certificate, among those whose revocation lists were taken over.

        Raises:
            UntrustedCertificateError: It is none of theirs.
        """
        for listed in self._lists.get(kind, {}).values():
            if is_issued_by(leaf, listed.issuer):
                return listed.issuer
        raise UntrustedCertificateError(
            f"{leaf.subject.rfc4514_string()} was issued by no {kind} CA that stands"
        )

    def verify(self, chain: Sequence[bytes], kind: IdentityKind) -> x509.Certificate:
        """Verify a chain of DER certificates, the identity's own first.

        Returns:
            The identity's certificate.

        Raises:
            UntrustedCertificateError: It does not lead to the root over the kind's issuing CA,
                is outside of its validity, is revoked, has a name that is none of that kind, or
                no site where its kind has one.
        """
        self._follow()
        leaf, issuer = _pair(chain)
        self._require_led(issuer)
        self._require_issued(leaf, issuer)
        _require_kind(leaf, kind)
        self._require_not_revoked(leaf, issuer, kind)
        return leaf

    def verify_issued(self, chain: Sequence[bytes], kind: IdentityKind) -> x509.Certificate:
        """Verify that a CA of ours issued a certificate, and has not revoked it.

        It may have expired: for permanent facts, such as the site to which a name belongs.
        It proves nothing about the peer that shows it.

        Args:
            chain: DER certificates, the identity's own first.
            kind: Whose it is.

        Raises:
            UntrustedCertificateError: It does not lead to the root over the kind's issuing CA, is
                revoked, has a name that is none of that kind, or no site where its kind has one.
        """
        self._follow()
        leaf, issuer = _pair(chain)
        self._require_led(issuer)
        _require_signed(leaf, issuer)
        _require_kind(leaf, kind)
        self._require_not_revoked(leaf, issuer, kind)
        return leaf

    def require_good(
        self, leaf: x509.Certificate, issuer: x509.Certificate, kind: IdentityKind
    ) -> None:
        """Judge a pair that `verify` found good again, without the signatures: they stay valid.

        Raises:
            UntrustedCertificateError: It is outside of its validity now, or revoked, or its root
                does not stand any more.
        """
        self._follow()
        self._require_led(issuer)
        self._require_valid(leaf)
        self._require_not_revoked(leaf, issuer, kind)

    def _follow(self) -> None:
        """Take over the roots of the file, if it was replaced."""
        if self._file is None:
            return
        try:
            seen = version(self._file)
            if seen == self._seen:
                return
            roots = load_certificates(self._file)
        except (OSError, IdentityError) as error:
            log.warning("the roots that stand stay: %s: %s", self._file, error)
            return
        self._roots = roots
        self._led = {}
        self._seen = seen

    def _require_led(self, issuer: x509.Certificate) -> None:
        """Require that an issuing CA leads to a root, and that both are valid now."""
        for part in (self._root_of(issuer), issuer):
            self._require_valid(part)

    def _root_of(self, issuer: x509.Certificate) -> x509.Certificate:
        """The root that has certified an issuing CA.

        Raises:
            UntrustedCertificateError: None of those that are trusted has.
        """
        led, named = self._led, thumbprint(issuer)
        if named in led:
            return led[named]
        for root in self._roots:
            if is_issued_by(issuer, root):
                led[named] = root
                return root
        name = issuer.subject.rfc4514_string()
        raise UntrustedCertificateError(f"{name} was not issued by our CA, a root that we trust")

    def _require_issued(self, certificate: x509.Certificate, issuer: x509.Certificate) -> None:
        _require_signed(certificate, issuer)
        for part in (certificate, issuer):
            self._require_valid(part)

    def _require_valid(self, part: x509.Certificate) -> None:
        now = self._clock()
        if not part.not_valid_before_utc <= now <= part.not_valid_after_utc:
            raise UntrustedCertificateError(
                f"{part.subject.rfc4514_string()} is valid from {part.not_valid_before_utc} "
                f"to {part.not_valid_after_utc}; now is {now}"
            )

    def _require_issuing(self, issuer: x509.Certificate, kind: IdentityKind) -> None:
        self._require_led(issuer)
        if common_name(issuer) != kind.issuer:
            raise UntrustedCertificateError(f"{common_name(issuer)!r} is no {kind} CA")

    def _require_not_revoked(
        self, leaf: x509.Certificate, issuer: x509.Certificate, kind: IdentityKind
    ) -> None:
        lists = self._lists.get(kind)
        if lists is None:
            return
        listed = lists.get(thumbprint(issuer))
        if listed is None:
            raise UntrustedCertificateError(
                f"the {kind} CA that issued {common_name(leaf)} does not stand any more"
            )
        if listed.expires < self._clock():
            raise UntrustedCertificateError(
                f"the revocation list of the {kind} CA should have been renewed by {listed.expires}"
            )
        entry = listed.revocations.get_revoked_certificate_by_serial_number(leaf.serial_number)
        if entry is not None:
            raise UntrustedCertificateError(
                f"certificate of {common_name(leaf)} was revoked on {entry.revocation_date_utc}"
            )


def _require_signed(certificate: x509.Certificate, issuer: x509.Certificate) -> None:
    name = certificate.subject.rfc4514_string()
    try:
        constraints = issuer.extensions.get_extension_for_class(x509.BasicConstraints).value
        certificate.verify_directly_issued_by(issuer)
    except (x509.ExtensionNotFound, InvalidSignature, ValueError, TypeError) as error:
        raise UntrustedCertificateError(
            f"{name} was not issued by our CA {issuer.subject.rfc4514_string()}"
        ) from error
    if not constraints.ca:
        raise UntrustedCertificateError(f"issuer of {name} is no CA")


def _require_kind(leaf: x509.Certificate, kind: IdentityKind) -> None:
    try:
        issued_as = issuer_kind(leaf)
        name = common_name(leaf)
        public_key(leaf)
        issued_as.require_name(name)
        if issued_as.has_site:
            site_of(leaf)
    except IdentityError as error:
        raise UntrustedCertificateError(str(error)) from error
    if issued_as is not kind:
        raise UntrustedCertificateError(f"{name} is a {issued_as}, not a {kind}")


def _pair(chain: Sequence[bytes]) -> tuple[x509.Certificate, x509.Certificate]:
    if len(chain) != 2:
        raise UntrustedCertificateError(
            f"chain has {len(chain)} certificates; expected the identity's and its issuing CA's"
        )
    try:
        leaf, issuer = (read_certificate(bytes(item)) for item in chain)
    except IdentityError as error:
        raise UntrustedCertificateError(f"chain holds no certificate: {error}") from error
    return leaf, issuer
