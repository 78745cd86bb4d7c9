"""Renewal: the holder of a valid certificate gets the next one, for a fresh key."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING, Final

from cryptography import x509

from eskin.errors import EnvelopeError, IdentityError
from eskin.identity import ChainVerifier, IdentityKind, common_name, issuer_kind, site_of
from eskin.identity.certificates import read_certificate
from eskin.wire.envelope import Verifier, signer_chain
from eskin.wire.topics import RENEWAL
from eskin_ca.csr import requested_key
from eskin_ca.issuance_quota import IssuanceQuota

if TYPE_CHECKING:
    from collections.abc import Callable

    from cryptography.hazmat.primitives.asymmetric import ec

    from eskin.identity import CertificateAuthority


MOST: Final = 30
_HOUR: Final = timedelta(hours=1)


class RenewalService:
    """Judges requests to renew.

    Args:
        authority: Issues.
        lifetime: Of the certificates.
        grace: How long after its end a certificate may still be renewed, as a node may sleep.
        clock: The present.
        most: How many a name gets in an hour, or in a certificate's life where that is shorter.
    """

    def __init__(
        self,
        authority: CertificateAuthority,
        *,
        lifetime: timedelta,
        grace: timedelta,
        clock: Callable[[], datetime] = lambda: datetime.now(UTC),
        most: int = MOST,
    ) -> None:
        self._authority = authority
        self._lifetime = lifetime
        self._grace = grace
        self._clock = clock
        self._allowance = IssuanceQuota(most, min(_HOUR, lifetime).total_seconds())

    def judge(self, signed: bytes) -> None:
        """Refuse who would not be renewed, without waiting for the turn to change the CA.

        Args:
            signed: As for `renew`.

        Raises:
            IdentityError: The certificate would not be renewed.
        """
        self._judged(signed)

    def renew(self, signed: bytes) -> tuple[x509.Certificate, ...]:
        """Issue the next certificate.

        The same key may be asked for again, as an answer may be lost: it gets the same certificate.

        Args:
            signed: COSE_Sign1 by the old key, of a certificate request (PKCS #10, DER) by the new.

        Returns:
            The certificate, then the issuing CA's.

        Raises:
            LockedError: Another writer held the CA's lock for too long.
            TooOftenError: The name got many lately.
            IdentityError: The old certificate is revoked, too old or not ours, or its CA retired,
                or it does not speak for this request.
        """
        # An identity that is revoked meanwhile gets no new certificate.
        with self._authority.changing():
            old, key = self._judged(signed)
            kind, name = issuer_kind(old), common_name(old)
            latest = self._authority.latest(name)
            if latest is not None and latest[0].public_key() == key:
                return latest
            with self._allowance.take(name):
                return self._authority.issue(
                    kind,
                    name,
                    key,
                    site=site_of(old) if kind.has_site else "",
                    hosts=hosts_of(old),
                    lifetime=self._lifetime,
                )

    def _judged(self, signed: bytes) -> tuple[x509.Certificate, ec.EllipticCurvePublicKey]:
        """The certificate that is to be renewed, and for which key."""
        old, issuer = self._holder(signed)
        kind, name = issuer_kind(old), common_name(old)
        key = requested_key(self._opened(signed, old, kind, name))
        if not self._authority.stands(issuer, kind):
            raise IdentityError(f"the CA that issued {name} is retired; enrol it again")
        return old, key

    def _holder(self, signed: bytes) -> tuple[x509.Certificate, x509.Certificate]:
        """Who speaks and who issued it; not verified yet, but neither revoked nor too old."""
        try:
            old, issuer = (read_certificate(one) for one in signer_chain(signed))
        except (EnvelopeError, ValueError) as error:
            raise IdentityError(f"no request to renew: {error}") from error
        if self._authority.is_revoked(old):
            raise IdentityError(f"{common_name(old)} was revoked; enrol it again")
        if self._clock() > old.not_valid_after_utc + self._grace:
            raise IdentityError(
                f"certificate of {common_name(old)} ended on {old.not_valid_after_utc}, too long "
                "ago to be renewed; enrol again"
            )
        return old, issuer

    def _opened(self, signed: bytes, old: x509.Certificate, kind: IdentityKind, name: str) -> bytes:
        # Judged at the end of its validity, where that has passed.
        chains = ChainVerifier(
            *self._authority.roots, clock=lambda: min(self._clock(), old.not_valid_after_utc)
        )
        try:
            return Verifier(chains, kind=kind, name=name).verify(signed, topic=RENEWAL)
        except EnvelopeError as error:
            raise IdentityError(f"no request to renew of {name}: {error}") from error


def hosts_of(leaf: x509.Certificate) -> list[str]:
    """A server's names and addresses, which it keeps."""
    names = leaf.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    return [
        *names.get_values_for_type(x509.DNSName),
        *(str(address) for address in names.get_values_for_type(x509.IPAddress)),
    ]
