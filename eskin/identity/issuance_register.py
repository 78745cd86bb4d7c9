"""What an authority has issued and revoked: its ledger, and each name's latest chain."""

from __future__ import annotations

import logging
from contextlib import suppress
from dataclasses import replace
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Final

from eskin.errors import IdentityError
from eskin.identity.certificates import (
    common_name,
    issuer_kind,
    key_digest,
    pem,
    public_key,
    site_of,
)
from eskin.identity.identity import load_certificates, write_whole
from eskin.identity.issuance_log import IssuanceLog, Issued, Revocation
from eskin.runtime.files.create import make_folder

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from cryptography import x509
    from cryptography.hazmat.primitives.asymmetric import ec

log = logging.getLogger(__name__)

LEDGER: Final = "ledger.jsonl"


class IssuanceRegister:
    """Certificates issued by one CA; the writer holds its lock.

    Args:
        directory: The CA's folder.
    """

    def __init__(self, directory: Path) -> None:
        self._issued = directory / "issued"
        self._ledger = IssuanceLog(directory / LEDGER)

    def add(self, certificate: x509.Certificate, issuer: x509.Certificate) -> None:
        """Note a certificate that is issued, and keep its chain as its name's latest.

        The log's line is written first: every issued certificate can be revoked.

        Raises:
            OSError: It cannot be written; the certificate must not be given out.
        """
        name, kind = common_name(certificate), issuer_kind(certificate)
        entry = Issued(
            _serial(certificate),
            str(kind),
            name,
            certificate.not_valid_after_utc.isoformat(),
            issuer=_serial(issuer),
            key=key_digest(public_key(certificate)),
            site=site_of(certificate) if kind.has_site else "",
        )
        self._ledger.add(entry)
        make_folder(self._issued, mode=0o755)
        write_whole(self._issued / f"{name}.pem", pem((certificate, issuer)))

    def entries(self) -> list[Issued]:
        """All certificates ever issued, the latest word on each, in order of issue."""
        return self._ledger.entries()

    def length(self) -> int:
        """How many lines the ledger has: whatever is revoked from now on is beyond them."""
        return self._ledger.length()

    def latest(self, name: str) -> tuple[x509.Certificate, ...] | None:
        """The chain last issued to a name.

        ``None`` if there is none, or it was revoked, or is not at hand: then another can be issued.
        """
        if all(entry.name != name for entry in self.entries()):
            return None
        path = self._issued / f"{name}.pem"
        try:
            chain = load_certificates(path)
        except IdentityError as error:
            log.warning("the latest certificate of %s is not at hand: %s", name, error)
            return None
        entry = self._ledger.entry(_serial(chain[0]))
        if entry is None:
            log.warning("%s: the ledger does not know this certificate", path)
        return None if entry is None or entry.revoked is not None else chain

    def is_revoked(self, certificate: x509.Certificate) -> bool:
        """Whether a certificate was revoked.

        Of one that the ledger does not know, as a part of it was lost: whether its name was.
        """
        entry = self._ledger.entry(_serial(certificate))
        if entry is None:
            return self.revocation(common_name(certificate)) is not None
        return entry.revoked is not None

    def revocation(self, name: str) -> Revocation | None:
        """When a certificate of a name was revoked last; ``None`` if none ever was."""
        return self._ledger.revocation(name)

    def require_site(self, name: str, site: str) -> None:
        """Require that a name was issued to no other site: what it sent stays where it is.

        Raises:
            IdentityError: It was.
        """
        standing = self._ledger.site(name)
        if standing not in {None, site}:
            raise IdentityError(
                f"{name} was issued to {standing}; a name belongs to one site, so choose another "
                f"name for {site}"
            )

    def require_unrevoked(self, key: ec.EllipticCurvePublicKey) -> None:
        """Require that no certificate of a key was revoked.

        Raises:
            IdentityError: One was.
        """
        if self._ledger.is_revoked_key(key_digest(key)):
            raise IdentityError("this key was revoked; enrol with a fresh one, in a new folder")

    def revoke(self, name: str) -> list[Issued]:
        """Revoke all certificates of a name, and give those that stood.

        Raises:
            IdentityError: None was ever issued to it.
        """
        issued = [entry for entry in self.entries() if entry.name == name]
        if not issued:
            raise IdentityError(f"no certificate was issued to {name!r}; see `eskin pki list`")
        now = datetime.now(UTC).isoformat()
        revoked = [self._with_key(entry).revoke(now) for entry in issued if entry.revoked is None]
        if revoked:
            self._ledger.add(*revoked)
        return revoked

    def recall(self, listed: Mapping[str, datetime]) -> None:
        """Note again who was revoked, where the ledger has forgotten it.

        Args:
            listed: What a revocation list says: serial numbers, hexadecimal, and when.
        """
        forgotten = [
            self._with_key(entry).revoke(listed[entry.serial].isoformat())
            for entry in self.entries()
            if entry.revoked is None and entry.serial in listed
        ]
        if forgotten:
            self._ledger.add(*forgotten)
            names = ", ".join(entry.name for entry in forgotten)
            log.warning("revocations that the ledger had forgotten are noted again: %s", names)

    def _with_key(self, entry: Issued) -> Issued:
        """An older line names no key, but the certificate issued last may be at hand."""
        latest = None if entry.key else self.latest(entry.name)
        if latest is not None and _serial(latest[0]) == entry.serial:
            # A revocation does without the key rather than not be.
            with suppress(IdentityError):
                return replace(entry, key=key_digest(public_key(latest[0])))
        return entry


def _serial(certificate: x509.Certificate) -> str:
    return f"{certificate.serial_number:x}"
