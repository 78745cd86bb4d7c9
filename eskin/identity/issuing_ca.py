"""Issuing CAs: one a kind, or two while one takes over from the other.

A kind's file ``KIND.pem`` holds the certificates of its issuing CAs, the one that issues now first.
Keys lie in ``KIND.key`` and ``KIND.SERIAL.key``. ``KIND.anchor.pem`` holds the same CAs, each
signed by its own key.
"""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING, Final

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization

from eskin.errors import AuthorityError, IdentityError
from eskin.identity.certificates import ca_certificate, new_key, pem
from eskin.identity.identity import load_certificates, load_key, save_key, write_whole
from eskin.identity.roots import ROOT_NAME, is_issued_by, is_replaced, newer_root

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence
    from pathlib import Path

    from cryptography.hazmat.primitives.asymmetric import ec

    from eskin.identity.identity_kind import IdentityKind

ISSUER_LIFETIME: Final = timedelta(days=1825)
LIST_LIFETIME: Final = timedelta(days=7)


@dataclass(frozen=True, slots=True)
class Issuer:
    """One issuing CA.

    Attributes:
        certificate: Signed by the root.
        key: Its private key.
    """

    certificate: x509.Certificate
    key: ec.EllipticCurvePrivateKey

    @property
    def serial(self) -> str:
        """Serial number of its certificate, hexadecimal."""
        return f"{self.certificate.serial_number:x}"

    def revocation_list(
        self, revoked: Iterable[x509.RevokedCertificate], *, number: int, now: datetime
    ) -> bytes:
        """A revocation list (PEM; RFC 5280, section 5).

        Args:
            revoked: What it holds.
            number: Its place among its issuer's lists.
            now: When it is signed.
        """
        builder = x509.CertificateRevocationListBuilder(
            issuer_name=self.certificate.subject, last_update=now, next_update=now + LIST_LIFETIME
        )
        key = x509.AuthorityKeyIdentifier.from_issuer_public_key(self.key.public_key())
        builder = builder.add_extension(key, critical=False)
        builder = builder.add_extension(x509.CRLNumber(number), critical=False)
        for entry in revoked:
            builder = builder.add_revoked_certificate(entry)
        return builder.sign(self.key, hashes.SHA256()).public_bytes(serialization.Encoding.PEM)


def load_issuers(directory: Path, kind: IdentityKind) -> tuple[Issuer, ...]:
    """The issuing CAs of a kind, the one that issues now first.

    Raises:
        AuthorityError: A certificate or its key is missing or cannot be read.
    """
    try:
        keys = [load_key(path) for path in sorted(directory.glob(f"{kind}.*key"))]
    except IdentityError as error:
        raise AuthorityError(str(error)) from error
    issuers = []
    for certificate in issuing_certificates(directory, kind):
        held = [key for key in keys if key.public_key() == certificate.public_key()]
        if not held:
            raise AuthorityError(
                f"{directory}: the key of a {kind} CA is missing; bring it back from a backup"
            )
        issuers.append(Issuer(certificate, held[0]))
    return tuple(issuers)


def issuing_certificates(directory: Path, kind: IdentityKind) -> tuple[x509.Certificate, ...]:
    """Certificates of the issuing CAs of a kind, of the one that issues now first.

    Raises:
        AuthorityError: They cannot be read.
    """
    try:
        return load_certificates(directory / f"{kind}.pem")
    except IdentityError as error:
        raise AuthorityError(str(error)) from error


def known_issuer(directory: Path, standing: Sequence[Issuer]) -> Issuer:
    """Of a kind's issuing CAs the one below the older root, which everybody knows."""
    if not is_replaced(directory):
        return standing[0]
    new = newer_root(directory)
    old = [each for each in standing if not is_issued_by(each.certificate, new)]
    return (old or standing)[0]


def found_issuer(
    directory: Path,
    kind: IdentityKind,
    root_key: ec.EllipticCurvePrivateKey,
    *,
    standby: bool = False,
) -> None:
    """Make an issuing CA, which issues from now on; the one before stays beside it.

    Who trusts a kind's anchors must trust the new one before it issues: so ``KIND.pem`` is last.

    Args:
        directory: The CA's folder.
        kind: Of what it issues.
        root_key: Signs it.
        standby: Let the one before go on issuing.
    """
    file, anchors = directory / f"{kind}.pem", directory / f"{kind}.anchor.pem"
    before = load_certificates(file) if file.exists() else ()
    key = new_key()
    certificate = _certificate(kind, key, ROOT_NAME, root_key)
    anchor = _certificate(kind, key, kind.issuer, key)
    name = f"{kind}.{certificate.serial_number:x}.key" if before else f"{kind}.key"
    save_key(directory / name, key)
    trusted = load_certificates(anchors) if before else ()
    write_whole(anchors, pem([anchor, *trusted]))
    write_whole(file, pem([*before, certificate] if standby else [certificate, *before]))


def promote_issuer(directory: Path, kind: IdentityKind) -> None:
    """Let the issuing CA that stands by issue, and the other one stand beside it."""
    file = directory / f"{kind}.pem"
    write_whole(file, pem(load_certificates(file)[::-1]))


def retire_issuers(directory: Path, kind: IdentityKind, standing: Sequence[Issuer]) -> None:
    """Keep only the issuing CA that issues now, and delete the other's key."""
    current = standing[0]
    anchors = load_certificates(directory / f"{kind}.anchor.pem")
    kept = [a for a in anchors if a.public_key() == current.certificate.public_key()]
    write_whole(directory / f"{kind}.pem", pem([current.certificate]))
    write_whole(directory / f"{kind}.anchor.pem", pem(kept))
    for path in directory.glob(f"{kind}.*key"):
        if load_key(path).public_key() != current.key.public_key():
            path.unlink()


def has_leftovers(directory: Path, kind: IdentityKind) -> bool:
    """Whether there are keys or anchors of issuing CAs beside the one that issues now."""
    keys = list(directory.glob(f"{kind}.*key"))
    return len(keys) > 1 or len(load_certificates(directory / f"{kind}.anchor.pem")) > 1


def _certificate(
    kind: IdentityKind,
    key: ec.EllipticCurvePrivateKey,
    issuer: str,
    signer: ec.EllipticCurvePrivateKey,
) -> x509.Certificate:
    return ca_certificate(
        kind.issuer,
        key.public_key(),
        issuer=issuer,
        signer=signer,
        path_length=0,
        not_before=datetime.now(UTC),
        lifetime=ISSUER_LIFETIME,
    )
