"""Renewing an identity in its folder: a fresh key, and the old one kept until it is drained.

Steps, each of which may be the last before a power cut: the new key in ``next/``; the old pair in
``past/THUMBPRINT/``; the new chain beside its key; then key, then chain in their places.
`Identity.load` finds a pair that fits at any time, and `finish_renewal` completes an interrupted
renewal.
"""

from __future__ import annotations

import shutil
from typing import TYPE_CHECKING, Final

from eskin.errors import IdentityError
from eskin.identity.certificates import SKEW, new_key, pem
from eskin.identity.identity import (
    CHAIN_FILE,
    KEY_FILE,
    NEXT,
    Identity,
    load_certificates,
    load_key,
    save_key,
    write_whole,
)
from eskin.identity.roots import is_issued_by
from eskin.runtime.files.create import make_folder

if TYPE_CHECKING:
    from datetime import datetime, timedelta
    from pathlib import Path

    from cryptography import x509
    from cryptography.hazmat.primitives.asymmetric import ec

PAST: Final = "past"
_LEFT: Final = 1 / 3
"""Part of its life that is left when a certificate is renewed."""


def is_due(certificate: x509.Certificate, now: datetime) -> bool:
    """Whether a certificate should be renewed: a third of its life is left, or less."""
    return certificate.not_valid_after_utc - now <= _LEFT * _life(certificate)


def is_superseded(own: Identity) -> bool:
    """Whether another root issues now than the one to which an identity's certificate leads."""
    return not is_issued_by(own.chain[-1], own.roots[0])


def next_key(directory: Path) -> ec.EllipticCurvePrivateKey:
    """The key that will replace an identity's own; the same until it has.

    Raises:
        IdentityError: It cannot be written or read.
    """
    path = directory / NEXT / KEY_FILE
    try:
        if not path.exists():
            make_folder(path.parent)
            save_key(path, new_key())
    except OSError as error:
        raise IdentityError(f"{path}: a new key cannot be written: {error.strerror}") from error
    return load_key(path)


def install(directory: Path, chain: tuple[x509.Certificate, ...]) -> Identity:
    """Put `next_key` and its chain in the place of an identity's own, which goes to its past.

    Raises:
        IdentityError: The chain is of another key, or the folder cannot be written.
    """
    if chain[0].public_key() != next_key(directory).public_key():
        raise IdentityError(f"{directory}: the renewed certificate is of another key")
    own = Identity.load(directory)
    try:
        Identity.save(
            directory / PAST / own.thumbprint.hex(), key=own.key, chain=own.chain, roots=own.roots
        )
        write_whole(directory / NEXT / CHAIN_FILE, pem(chain))
        finish_renewal(directory)
    except OSError as error:
        raise IdentityError(f"{directory}: cannot be renewed: {error.strerror}") from error
    return Identity.load(directory)


def finish_renewal(directory: Path) -> None:
    """Finish a renewal that was cut off after its chain had come.

    Raises:
        OSError: The folder cannot be written.
    """
    key, chain = (directory / NEXT / name for name in (KEY_FILE, CHAIN_FILE))
    if not chain.exists():
        return
    if key.exists():
        save_key(directory / KEY_FILE, load_key(key))
        write_whole(directory / CHAIN_FILE, chain.read_bytes())
        key.unlink()
    chain.unlink()


def past_identities(directory: Path) -> list[Identity]:
    """What an identity was before, as far as it is kept, newest first.

    Raises:
        IdentityError: One cannot be read.
    """
    folders = [path.parent for path in (directory / PAST).glob(f"*/{CHAIN_FILE}")]
    found = [Identity.load(folder) for folder in folders]
    return sorted(found, key=lambda own: own.certificate.not_valid_after_utc, reverse=True)


def forget_past(directory: Path, now: datetime) -> None:
    """Delete past keys whose certificate expired longer ago than it was valid.

    And what was cut off: where there is a chain, there is all of it, so it comes last and goes
    first.

    Raises:
        OSError: The folder cannot be written.
    """
    for folder in (directory / PAST).glob("*/"):
        chain = folder / CHAIN_FILE
        if chain.exists():
            certificate = load_certificates(chain)[0]
            if now <= certificate.not_valid_after_utc + _life(certificate):
                continue
            chain.unlink()
        shutil.rmtree(folder)


def _life(certificate: x509.Certificate) -> timedelta:
    return certificate.not_valid_after_utc - certificate.not_valid_before_utc - SKEW
