"""A CA's revocation lists: for each kind a file, signed from what the ledger says.

Who was on a list stays on it, also where the ledger was brought back from a backup and has
forgotten it; then the ledger learns it again from the list.

A list's number is the second in which it is signed, or one more than the last number if the clock
was set back, so clients that follow numbers take the newest. OpenSSL goes by the times alone, and
prefers an older list as soon as its time comes; a new list is due then.
"""

from __future__ import annotations

import time
from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING

from cryptography import x509

from eskin.errors import IdentityError
from eskin.identity.certificates import UNREADABLE, pem
from eskin.identity.crl import number_of, read_lists, revoked_certificates
from eskin.identity.identity import write_whole
from eskin.identity.issuing_ca import LIST_LIFETIME, issuing_certificates, load_issuers

if TYPE_CHECKING:
    from pathlib import Path

    from eskin.identity.identity_kind import IdentityKind
    from eskin.identity.issuance_log import Issued
    from eskin.identity.issuance_register import IssuanceRegister
    from eskin.runtime.files.lock import ReentrantLock


class RevocationLists:
    """Of one CA.

    Args:
        directory: The CA's folder.
        register: What was revoked.
        turn: Whose turn it is to change the folder.
    """

    def __init__(self, directory: Path, register: IssuanceRegister, turn: ReentrantLock) -> None:
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
            listed = self._listed(kind)
            self._register.recall({each: one.revocation_date_utc for each, one in listed.items()})
            revoked = listed | {one.serial: _entry(one) for one in self._revoked(kind)}
            now, number = datetime.now(UTC), self._next_number(kind)
            issuers = load_issuers(self._directory, kind)
            lists = [
                issuer.revocation_list(revoked.values(), number=number, now=now)
                for issuer in issuers
            ]
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

    def holds(self, kind: IdentityKind, certificate: x509.Certificate) -> bool:
        """Whether the kind's list revokes a certificate."""
        return f"{certificate.serial_number:x}" in self._listed(kind)

    def is_due(self, kind: IdentityKind) -> bool:
        """Whether a day has passed since the list was signed, or it lacks a revoked certificate."""
        standing = self._standing(kind)
        if standing is None or standing.next_update_utc is None or not self.is_complete(kind):
            return True
        now = datetime.now(UTC)
        if standing.next_update_utc - now < LIST_LIFETIME - timedelta(days=1):
            return True
        if _second(standing.last_update_utc) < number_of(standing) < _second(now):
            return True
        listed = self._listed(kind)
        own = [one for one in self._register.entries() if one.kind == kind]
        return any((one.revoked is None) == (one.serial in listed) for one in own)

    def is_complete(self, kind: IdentityKind) -> bool:
        """Whether the issuing CAs that stand, and no others, have signed the list."""
        issuers = set(issuing_certificates(self._directory, kind))
        try:
            lists = read_lists(self.file(kind).read_bytes(), {}, lambda _: None)
        except (OSError, IdentityError):
            return False
        return {each.issuer for each in lists.values()} == issuers

    def _next_number(self, kind: IdentityKind) -> int:
        standing, now = self._standing(kind), _second(datetime.now(UTC))
        return now if standing is None else max(now, number_of(standing) + 1)

    def _revoked(self, kind: IdentityKind) -> list[Issued]:
        entries = self._register.entries()
        return [one for one in entries if one.kind == kind and one.revoked is not None]

    def _listed(self, kind: IdentityKind) -> dict[str, x509.RevokedCertificate]:
        """Serial numbers in the present list; none if it cannot be read."""
        try:
            return revoked_certificates(self.file(kind).read_bytes())
        except (OSError, *UNREADABLE):
            return {}

    def _standing(self, kind: IdentityKind) -> x509.CertificateRevocationList | None:
        """The list that stands; one that cannot be read is as good as none."""
        try:
            standing = x509.load_pem_x509_crl(self.file(kind).read_bytes())
            _ = number_of(standing), standing.next_update_utc  # parsed when asked for, no sooner
        except (OSError, *UNREADABLE):
            return None
        return standing


def _second(instant: datetime) -> int:
    return int(instant.timestamp())


def _entry(entry: Issued) -> x509.RevokedCertificate:
    revoked = datetime.fromisoformat(entry.revoked or "")
    return (
        x509.RevokedCertificateBuilder()
        .serial_number(int(entry.serial, 16))
        .revocation_date(revoked)
        .build()
    )
