"""A CA's revocation lists: for each kind a file, signed from what the ledger says."""

from __future__ import annotations

import time
from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING

from cryptography import x509

from eskin.errors import IdentityError
from eskin.identity.certificates import pem
from eskin.identity.identity import load_certificates, write_whole
from eskin.identity.issuer import LIST_LIFETIME, load_issuers
from eskin.identity.revocations import revoked_serials

if TYPE_CHECKING:
    from pathlib import Path

    from eskin.identity.kinds import IdentityKind
    from eskin.identity.ledger import Issued
    from eskin.identity.register import Register
    from eskin.identity.turn import Turn


class RevocationLists:
    """Of one CA.

    Args:
        directory: The CA's folder.
        register: What was revoked.
        turn: Whose turn it is to change the folder.
    """

    def __init__(self, directory: Path, register: Register, turn: Turn) -> None:
        self._directory = directory
        self._register = register
        self._turn = turn

    def file(self, kind: IdentityKind) -> Path:
        """The file with the kind's list."""
        return self._directory / f"{kind}.crl.pem"

    def write(self, kind: IdentityKind) -> None:
        """Sign the kind's list.

        The file holds the certificate of each issuing CA, then the list that this one signed.
        """
        with self._turn.take():
            revoked = self._revoked(kind)
            issuers = load_issuers(self._directory, kind)
            lists = [issuer.revocation_list(revoked) for issuer in issuers]
            certificates = pem([issuer.certificate for issuer in issuers])
            write_whole(self.file(kind), certificates + b"".join(lists))

    def publish(self, kind: IdentityKind) -> None:
        """Sign the kind's list so that it counts as newer than the one that stands.

        OpenSSL takes the newer of two lists, and their times are whole seconds.
        """
        standing = self._standing(kind)
        if standing is not None:
            due = standing.last_update_utc + timedelta(seconds=1)
            time.sleep(min(max((due - datetime.now(UTC)).total_seconds(), 0.0), 1.0))
        self.write(kind)

    def is_due(self, kind: IdentityKind) -> bool:
        """Whether a day has passed since the list was signed, or it lacks whom it should hold."""
        standing = self._standing(kind)
        if standing is None or standing.next_update_utc is None or not self.is_complete(kind):
            return True
        if standing.next_update_utc - datetime.now(UTC) < LIST_LIFETIME - timedelta(days=1):
            return True
        listed = revoked_serials(self.file(kind).read_bytes())
        return not listed.issuperset(entry.serial for entry in self._revoked(kind))

    def is_complete(self, kind: IdentityKind) -> bool:
        """Whether the issuing CAs that stand, and no others, have signed the list."""
        issuers = load_certificates(self._directory / f"{kind}.pem")
        try:
            return set(load_certificates(self.file(kind))) == set(issuers)
        except IdentityError:
            return False

    def _revoked(self, kind: IdentityKind) -> list[Issued]:
        entries = self._register.entries()
        return [one for one in entries if one.kind == kind and one.revoked is not None]

    def _standing(self, kind: IdentityKind) -> x509.CertificateRevocationList | None:
        """The list that stands; one that cannot be read is as good as none."""
        try:
            return x509.load_pem_x509_crl(self.file(kind).read_bytes())
        except (OSError, ValueError):
            return None
