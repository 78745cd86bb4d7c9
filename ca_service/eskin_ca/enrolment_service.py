"""Enrolling: who holds a token gets a first certificate, for a key that was never revoked."""

from __future__ import annotations

import logging
from datetime import UTC, datetime
from typing import TYPE_CHECKING

from cryptography.hazmat.primitives import serialization

from eskin.identity import is_due
from eskin_ca.csr import requested_key, requested_name
from eskin_ca.renewal_service import hosts_of

if TYPE_CHECKING:
    from datetime import timedelta

    from cryptography import x509
    from cryptography.hazmat.primitives.asymmetric import ec

    from eskin.identity import CertificateAuthority
    from eskin_ca.tokens import Enrolment, Tokens

log = logging.getLogger(__name__)


class EnrolmentService:
    """Judges requests to enrol.

    Args:
        authority: Issues.
        tokens: Who may enrol.
        lifetime: Of the certificates.
    """

    def __init__(
        self, authority: CertificateAuthority, tokens: Tokens, *, lifetime: timedelta
    ) -> None:
        self._authority = authority
        self._tokens = tokens
        self._lifetime = lifetime

    def judge(self, token: str, request: bytes) -> None:
        """Refuse who would not be enrolled, without waiting for the turn to change the CA.

        Args:
            token: As its holder gives it.
            request: Certificate request (PKCS #10, DER).

        Raises:
            IdentityError: The token is not good for this key or name, or the key was revoked.
        """
        register, key = self._authority.register, requested_key(request)
        register.require_unrevoked(key)
        name = requested_name(request)
        self._tokens.judge(token, _der(key), name, revocation=register.revocation)

    def enrol(self, token: str, request: bytes) -> tuple[x509.Certificate, ...]:
        """Issue a certificate.

        Args:
            token: As its holder gives it.
            request: Certificate request (PKCS #10, DER).

        Returns:
            The certificate, then the issuing CA's; the same for the same key again, as an answer
            may be lost.

        Raises:
            LockedError: Another writer held the CA's lock for too long.
            IdentityError: The token is not good for this key or name, or the key was revoked.
        """
        key, name = requested_key(request), requested_name(request)
        register = self._authority.register
        # An identity that is revoked meanwhile gets no new certificate.
        with self._authority.changing():
            register.require_unrevoked(key)
            found = self._tokens.redeem(token, _der(key), name, revocation=register.revocation)
            standing = self._standing(found, key)
            if standing is not None:
                return standing
            chain = self._authority.issue(
                found.kind,
                found.name,
                key,
                site=found.site,
                hosts=found.hosts,
                lifetime=self._lifetime,
            )
        log.info("enrolled: kind=%s name=%s", found.kind, found.name)
        return chain

    def _standing(
        self, found: Enrolment, key: ec.EllipticCurvePublicKey
    ) -> tuple[x509.Certificate, ...] | None:
        """What the key got before, where its answer was lost: another would be one more to keep."""
        latest = self._authority.latest(found.name)
        if latest is None or latest[0].public_key() != key:
            return None
        issuer = self._authority.issuer(found.kind, found.name).certificate
        fits = latest[1] == issuer and set(hosts_of(latest[0])) == set(found.hosts)
        return latest if fits and not is_due(latest[0], datetime.now(UTC)) else None


def _der(key: ec.EllipticCurvePublicKey) -> bytes:
    encoding, form = serialization.Encoding.DER, serialization.PublicFormat.SubjectPublicKeyInfo
    return key.public_bytes(encoding, form)
