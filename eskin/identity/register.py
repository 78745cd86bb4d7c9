"""What an authority has issued and revoked: its ledger, and each name's latest chain."""

from __future__ import annotations

from dataclasses import replace
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Final

from eskin.errors import IdentityError
from eskin.identity.certificates import common_name, issuer_kind, key_digest, pem, public_key
from eskin.identity.identity import load_certificates, write_whole
from eskin.identity.ledger import Issued, Ledger

if TYPE_CHECKING:
    from pathlib import Path

    from cryptography import x509
    from cryptography.hazmat.primitives.asymmetric import ec

LEDGER: Final = "ledger.jsonl"


class Register:
    """Of one CA; whoever writes has its turn.

    Args:
        directory: The CA's folder.
    """

    def __init__(self, directory: Path) -> None:
        self._issued = directory / "issued"
        self._ledger = Ledger(directory / LEDGER)

    def add(self, certificate: x509.Certificate, issuer: x509.Certificate) -> None:
        """Note a certificate that was issued, and keep its chain as its name's latest."""
        name = common_name(certificate)
        self._issued.mkdir(exist_ok=True)
        write_whole(self._issued / f"{name}.pem", pem((certificate, issuer)))
        entry = Issued(
            _serial(certificate),
            str(issuer_kind(certificate)),
            name,
            certificate.not_valid_after_utc.isoformat(),
            issuer=_serial(issuer),
            key=key_digest(public_key(certificate)),
        )
        self._ledger.add(entry)

    def entries(self) -> list[Issued]:
        """All certificates ever issued, the latest word on each, in order of issue."""
        return self._ledger.entries()

    def latest(self, name: str) -> tuple[x509.Certificate, ...] | None:
        """The chain last issued to a name; ``None`` if there is none."""
        if all(entry.name != name for entry in self.entries()):
            return None
        return load_certificates(self._issued / f"{name}.pem")

    def is_revoked(self, certificate: x509.Certificate) -> bool:
        """Whether a certificate was revoked."""
        return self._ledger.is_revoked(_serial(certificate))

    def revoked_at(self, name: str) -> datetime | None:
        """When a certificate of a name was revoked last; ``None`` if none ever was."""
        return self._ledger.revoked_at(name)

    def require_unrevoked(self, key: ec.EllipticCurvePublicKey) -> None:
        """Require that no certificate of a key was revoked.

        Raises:
            IdentityError: One was.
        """
        if self._ledger.is_revoked_key(key_digest(key)):
            raise IdentityError("this key was revoked; enrol with a fresh one, in a new folder")

    def revoke(self, name: str) -> list[Issued]:
        """Revoke all certificates of a name.

        Raises:
            IdentityError: None of them stands.
        """
        standing = [e for e in self.entries() if e.name == name and e.revoked is None]
        if not standing:
            raise IdentityError(f"no standing certificate of {name!r}; see `eskin pki list`")
        now = datetime.now(UTC).isoformat()
        revoked = [self._with_key(entry).revoke(now) for entry in standing]
        self._ledger.add(*revoked)
        return revoked

    def _with_key(self, entry: Issued) -> Issued:
        """An older line tells no key, but the certificate issued last may be at hand."""
        latest = None if entry.key else self.latest(entry.name)
        if latest is None or _serial(latest[0]) != entry.serial:
            return entry
        return replace(entry, key=key_digest(public_key(latest[0])))


def _serial(certificate: x509.Certificate) -> str:
    return f"{certificate.serial_number:x}"
