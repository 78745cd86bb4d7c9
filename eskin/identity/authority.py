"""The certificate authority: a root, and one issuing CA for each kind of identity.

Its folder holds ``root.pem``, ``root.key``, and for each kind ``KIND.pem``, ``KIND.key``,
``KIND.anchor.pem`` and ``KIND.crl.pem``; what was issued last in ``issued/NAME.pem``, and a
``ledger.jsonl`` of everything issued and revoked. An *anchor* is the issuing CA's certificate
signed by its own key: a TLS server that trusts only this one accepts that kind and no other, which
the root as anchor could not say.
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING, Final, Self

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization

from eskin.errors import IdentityError
from eskin.identity.certificates import ca_certificate, leaf_certificate, new_key, pem
from eskin.identity.identity import load_certificates, load_key, save_key, write_whole
from eskin.identity.kinds import IdentityKind

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from cryptography.hazmat.primitives.asymmetric import ec

ROOT_NAME: Final = "eskin root CA"
ROOT_LIFETIME: Final = timedelta(days=3650)
ISSUER_LIFETIME: Final = timedelta(days=1825)
LEAF_LIFETIME: Final = timedelta(days=90)
CRL_LIFETIME: Final = timedelta(days=7)
_LEDGER: Final = "ledger.jsonl"


@dataclass(frozen=True, slots=True)
class Issued:
    """One line of the ledger: a certificate that was issued, or its revocation.

    Attributes:
        serial: Serial number, hexadecimal.
        kind: Kind of the identity.
        name: Common name.
        expires: RFC 3339.
        revoked: RFC 3339, or ``None``.
    """

    serial: str
    kind: str
    name: str
    expires: str
    revoked: str | None = None


class Authority:
    """A root CA and its issuing CAs, kept in one folder."""

    def __init__(self, directory: Path) -> None:
        """Open the folder.

        Raises:
            IdentityError: There is no CA, or a key or certificate cannot be read.
        """
        if not (directory / "root.pem").is_file():
            raise IdentityError(
                f"{directory}: there is no CA; `eskin pki init --dir {directory}` makes one"
            )
        self._directory = directory
        self.root = load_certificates(directory / "root.pem")[0]
        self._issuers = {
            kind: load_certificates(directory / f"{kind}.pem")[0] for kind in IdentityKind
        }
        self._keys = {kind: load_key(directory / f"{kind}.key") for kind in IdentityKind}

    @classmethod
    def open(cls, directory: Path) -> Self:
        """Open the folder; make a fresh authority where there is none.

        Raises:
            IdentityError: It cannot be read or written.
        """
        if not (directory / "root.pem").exists():
            try:
                _create(directory)
            except OSError as error:
                raise IdentityError(
                    f"{directory}: no CA can be made here: {error.strerror}; choose another folder"
                ) from error
        authority = cls(directory)
        for kind in IdentityKind:
            if not authority.revocations_file(kind).exists():
                authority.write_revocations(kind)
        return authority

    @classmethod
    def create(cls, directory: Path) -> Self:
        """Make a fresh authority where there is none.

        Raises:
            IdentityError: There is one, or the folder cannot be written.
        """
        if (directory / "root.pem").exists():
            raise IdentityError(
                f"{directory}: there is a CA already, which stays as it is; "
                "choose another folder for a new one"
            )
        return cls.open(directory)

    def issue(
        self,
        kind: IdentityKind,
        name: str,
        key: ec.EllipticCurvePublicKey,
        *,
        hosts: Sequence[str] = (),
        lifetime: timedelta = LEAF_LIFETIME,
        now: datetime | None = None,
    ) -> tuple[x509.Certificate, ...]:
        """Issue a certificate.

        Args:
            kind: Kind of the identity.
            name: Common name, see `eskin.identity.kinds`.
            key: The identity's public key.
            hosts: DNS names and addresses of a server.
            lifetime: How long it is valid.
            now: Start of its validity; the present by default.

        Returns:
            The certificate, then the issuing CA's.

        Raises:
            IdentityError: The name is none of that kind.
        """
        kind.require_name(name)
        certificate = leaf_certificate(
            kind,
            name,
            key,
            hosts=hosts,
            signer=self._keys[kind],
            not_before=now or datetime.now(UTC),
            lifetime=lifetime,
        )
        chain = certificate, self._issuers[kind]
        issued = self._directory / "issued"
        issued.mkdir(exist_ok=True)
        write_whole(issued / f"{name}.pem", pem(chain))
        expires = certificate.not_valid_after_utc.isoformat()
        self._record(Issued(f"{certificate.serial_number:x}", str(kind), name, expires))
        return chain

    def latest(self, name: str) -> tuple[x509.Certificate, ...] | None:
        """The chain last issued to a name; ``None`` if there is none."""
        if all(entry.name != name for entry in self.issued()):
            return None
        return load_certificates(self._directory / "issued" / f"{name}.pem")

    def issued(self) -> list[Issued]:
        """All certificates ever issued, the latest word on each, in order of issue."""
        latest: dict[str, Issued] = {}
        path = self._directory / _LEDGER
        if path.exists():
            for line in path.read_text().splitlines():
                entry = Issued(**json.loads(line))
                latest[entry.serial] = entry
        return list(latest.values())

    def is_revoked(self, certificate: x509.Certificate) -> bool:
        """Whether a certificate was revoked."""
        serial = f"{certificate.serial_number:x}"
        return any(e.serial == serial and e.revoked is not None for e in self.issued())

    def revoke(self, name: str) -> list[Issued]:
        """Revoke all certificates of a name, and write its kind's revocation list anew.

        Raises:
            IdentityError: None was issued to that name.
        """
        standing = [e for e in self.issued() if e.name == name and e.revoked is None]
        if not standing:
            raise IdentityError(f"no standing certificate of {name!r}; see `eskin pki list`")
        now = datetime.now(UTC).isoformat()
        revoked = [Issued(e.serial, e.kind, e.name, e.expires, now) for e in standing]
        for entry in revoked:
            self._record(entry)
        self.write_revocations(IdentityKind(standing[0].kind))
        return revoked

    def write_revocations(self, kind: IdentityKind) -> Path:
        """Sign the kind's revocation list (RFC 5280, section 5) and give its path."""
        now = datetime.now(UTC)
        issuer = self._issuers[kind]
        builder = x509.CertificateRevocationListBuilder(
            issuer_name=issuer.subject, last_update=now, next_update=now + CRL_LIFETIME
        )
        for entry in self.issued():
            if entry.kind == kind and entry.revoked is not None:
                builder = builder.add_revoked_certificate(_revocation(entry))
        signed = builder.sign(self._keys[kind], hashes.SHA256())
        path = self.revocations_file(kind)
        write_whole(path, signed.public_bytes(serialization.Encoding.PEM))
        return path

    def anchor_file(self, kind: IdentityKind) -> Path:
        """The file with the kind's anchor, for a TLS server that takes only this kind."""
        return self._directory / f"{kind}.anchor.pem"

    def revocations_file(self, kind: IdentityKind) -> Path:
        """The file with the kind's revocation list."""
        return self._directory / f"{kind}.crl.pem"

    @property
    def root_file(self) -> Path:
        """The file with the root's certificate."""
        return self._directory / "root.pem"

    def _record(self, entry: Issued) -> None:
        with (self._directory / _LEDGER).open("a") as ledger:
            ledger.write(json.dumps(asdict(entry)) + "\n")


def _revocation(entry: Issued) -> x509.RevokedCertificate:
    revoked = datetime.fromisoformat(entry.revoked or "")
    return (
        x509.RevokedCertificateBuilder()
        .serial_number(int(entry.serial, 16))
        .revocation_date(revoked)
        .build()
    )


def _create(directory: Path) -> None:
    """Make keys and certificates; the root's last, so that its presence means all is there."""
    if (directory / _LEDGER).exists():
        raise IdentityError(
            f"{directory}: there is a {_LEDGER} but no root.pem; bring it back from a backup, as a "
            "new CA would disown all that was issued"
        )
    directory.mkdir(parents=True, exist_ok=True, mode=0o700)
    now = datetime.now(UTC)
    root_key = new_key()
    for kind in IdentityKind:
        key = new_key()
        save_key(directory / f"{kind}.key", key)
        for issuer, signer, file in (
            (ROOT_NAME, root_key, f"{kind}.pem"),
            (kind.issuer, key, f"{kind}.anchor.pem"),
        ):
            certificate = ca_certificate(
                kind.issuer,
                key.public_key(),
                issuer=issuer,
                signer=signer,
                path_length=0,
                not_before=now,
                lifetime=ISSUER_LIFETIME,
            )
            write_whole(directory / file, pem([certificate]))
    root = ca_certificate(
        ROOT_NAME,
        root_key.public_key(),
        issuer=ROOT_NAME,
        signer=root_key,
        path_length=1,
        not_before=now,
        lifetime=ROOT_LIFETIME,
    )
    save_key(directory / "root.key", root_key)
    write_whole(directory / "root.pem", pem([root]))
