"""Making a CA: a root, and one issuing CA for each kind of identity."""

from __future__ import annotations

from typing import TYPE_CHECKING

from eskin.errors import IdentityError
from eskin.identity.certificates import new_key, pem
from eskin.identity.identity import ROOT_FILE, save_key, write_whole
from eskin.identity.identity_kind import IdentityKind
from eskin.identity.issuance_register import LEDGER
from eskin.identity.issuing_ca import found_issuer
from eskin.identity.roots import root_certificate
from eskin.runtime.files.lock import ReentrantLock

if TYPE_CHECKING:
    from pathlib import Path


def create_ca(directory: Path) -> bool:
    """Make a CA where there is none; gives whether there was none. One process at a time does.

    Raises:
        IdentityError: The folder cannot be written.
    """
    if (directory / ROOT_FILE).exists():
        return False
    try:
        with ReentrantLock(directory / LEDGER).take():
            if (directory / ROOT_FILE).exists():
                return False
            _create(directory)
    except OSError as error:
        raise IdentityError(
            f"{directory}: no CA can be made here: {error.strerror}; choose another folder"
        ) from error
    return True


def _create(directory: Path) -> None:
    """Make keys and certificates; the root's last, so that its presence means all is there."""
    if (directory / LEDGER).exists():
        raise IdentityError(
            f"{directory}: there is a {LEDGER} but no root.pem; bring it back from a backup, as a "
            "new CA would disown all that was issued"
        )
    key = new_key()
    for kind in IdentityKind:
        # What an interrupted attempt left is not kept beside it.
        (directory / f"{kind}.pem").unlink(missing_ok=True)
        found_issuer(directory, kind, key)
    save_key(directory / "root.key", key)
    write_whole(directory / ROOT_FILE, pem([root_certificate(key)]))
