"""Root CAs: one, or two while one takes over from the other.

The CA's ``root.pem`` holds those that stand, the one that issues first; everybody keeps a copy.
Keys lie in ``root.key`` and ``root.SERIAL.key``. While two stand, ``root.cross.pem`` holds the
newer one's key, certified by the older one, so that clients that trust the older one accept the
newer one.
"""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING, Final

from cryptography.exceptions import InvalidSignature

from eskin.errors import IdentityError, UntrustedCertificateError
from eskin.identity.certificates import ca_certificate, new_key, pem
from eskin.identity.identity import ROOT_FILE, load_certificates, load_key, save_key, write_whole

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from cryptography import x509
    from cryptography.hazmat.primitives.asymmetric import ec

ROOT_NAME: Final = "eskin root CA"
ROOT_LIFETIME: Final = timedelta(days=3650)
CROSS_FILE: Final = "root.cross.pem"


def is_issued_by(certificate: x509.Certificate, issuer: x509.Certificate) -> bool:
    """Whether a certificate names an issuer, and bears its signature."""
    try:
        certificate.verify_directly_issued_by(issuer)
    except (InvalidSignature, ValueError, TypeError):
        return False
    return True


def root_certificate(key: ec.EllipticCurvePrivateKey) -> x509.Certificate:
    """A root's certificate, signed by itself."""
    return _certificate(key.public_key(), key)


def root_key(directory: Path, root: x509.Certificate) -> ec.EllipticCurvePrivateKey:
    """The private key of a root.

    Raises:
        IdentityError: It is not here.
    """
    for path in sorted(directory.glob("root.*key")):
        key = load_key(path)
        if key.public_key() == root.public_key():
            return key
    raise IdentityError(
        f"{directory}: the root's key is not here; bring it back from where it is kept"
    )


def found_root(directory: Path) -> None:
    """Make another root, which is trusted from now on and issues nothing yet.

    Raises:
        IdentityError: The standing root's key is not here.
    """
    (standing,) = load_certificates(directory / ROOT_FILE)
    signer, key = root_key(directory, standing), new_key()
    root = root_certificate(key)
    save_key(directory / f"root.{root.serial_number:x}.key", key)
    write_whole(directory / CROSS_FILE, pem([_certificate(key.public_key(), signer)]))
    write_whole(directory / ROOT_FILE, pem([standing, root]))


def is_replaced(directory: Path) -> bool:
    """Whether a root has taken over, or is to; not yet where its making was cut off."""
    return _newer(directory) is not None


def newer_root(directory: Path) -> x509.Certificate:
    """Of two roots, the one that the other has certified.

    Raises:
        IdentityError: No root is being replaced.
    """
    newer = _newer(directory)
    if newer is None:
        raise IdentityError(
            f"{directory}: no root is being replaced; see `eskin pki rotate --root`"
        )
    return newer


def offered_roots(directory: Path) -> bytes:
    """What `accept_roots` reads, as PEM: the standing roots, and who vouches for the newer one."""
    files = [directory / ROOT_FILE, *directory.glob(CROSS_FILE)]
    return pem([one for file in files for one in load_certificates(file)])


def retire_root(directory: Path) -> None:
    """Keep only the root that issues now, and delete the other's key.

    The marker of an unfinished rotation is deleted last.
    """
    current = load_certificates(directory / ROOT_FILE)[0]
    write_whole(directory / ROOT_FILE, pem([current]))
    for path in directory.glob("root.*key"):
        if load_key(path).public_key() != current.public_key():
            path.unlink()
    (directory / CROSS_FILE).unlink(missing_ok=True)


def accept_roots(
    trusted: Sequence[x509.Certificate], offered: Sequence[x509.Certificate], now: datetime
) -> tuple[x509.Certificate, ...]:
    """Which roots to trust from now on, by what the CA offers.

    Args:
        trusted: Roots that were trusted so far.
        offered: Roots that stand, and cross certificates of those that are new.
        now: The present.

    Raises:
        UntrustedCertificateError: There is none, or one of them is not certified.
    """
    roots = tuple(one for one in offered if is_issued_by(one, one))
    if not roots:
        raise UntrustedCertificateError("no root CA was offered")
    vouched = [
        one.public_key()
        for one in offered
        if one.not_valid_before_utc <= now <= one.not_valid_after_utc
        and any(is_issued_by(one, root) for root in trusted)
    ]
    for root in roots:
        if root not in trusted and root.public_key() not in vouched:
            raise UntrustedCertificateError(
                f"for the new root CA {root.serial_number:x} no root vouches that is trusted"
            )
    return roots


def _newer(directory: Path) -> x509.Certificate | None:
    if not (directory / CROSS_FILE).exists():
        return None
    (cross,) = load_certificates(directory / CROSS_FILE)
    roots = load_certificates(directory / ROOT_FILE)
    return next((root for root in roots if root.public_key() == cross.public_key()), None)


def _certificate(
    key: ec.EllipticCurvePublicKey, signer: ec.EllipticCurvePrivateKey
) -> x509.Certificate:
    return ca_certificate(
        ROOT_NAME,
        key,
        issuer=ROOT_NAME,
        signer=signer,
        path_length=1,
        not_before=datetime.now(UTC),
        lifetime=ROOT_LIFETIME,
    )
