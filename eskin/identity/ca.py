"""The certificate authority: a root, and one issuing CA for each kind of identity.

Its folder holds the root (see `eskin.identity.roots`), the issuing CAs (see
`eskin.identity.issuing_ca`), for each kind ``KIND.crl.pem``, what was issued last in
``issued/NAME.pem``, and a ``ledger.jsonl`` of everything issued and revoked. An *anchor* is an
issuing CA's certificate signed by its own key: a TLS server that trusts only this one accepts that
kind and no other, which the root as anchor could not say. A writer of the folder holds
``ledger.jsonl.lock`` meanwhile (see `eskin.runtime.files.lock`).
"""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING, Final, Self

from eskin.errors import AuthorityError, IdentityError
from eskin.identity.certificates import issuer_kind, leaf_certificate, new_key, pem
from eskin.identity.crl_publisher import RevocationLists
from eskin.identity.identity import ROOT_FILE, load_certificates, save_key, write_whole
from eskin.identity.identity_kind import IdentityKind
from eskin.identity.issuance_register import LEDGER, IssuanceRegister
from eskin.identity.issuing_ca import (
    found_issuer,
    has_leftovers,
    known_issuer,
    load_issuers,
    retire_issuers,
)
from eskin.identity.roots import is_replaced, root_certificate, root_key
from eskin.runtime.files.lock import ReentrantLock

if TYPE_CHECKING:
    from collections.abc import Sequence
    from contextlib import AbstractContextManager
    from pathlib import Path

    from cryptography import x509
    from cryptography.hazmat.primitives.asymmetric import ec

    from eskin.identity.issuance_log import Issued
    from eskin.identity.issuing_ca import Issuer

LEAF_LIFETIME: Final = timedelta(days=90)
CA_SERVICE: Final = "server.authority"
"""Common name of the CA service, which clients verify by the oldest valid root."""


class CertificateAuthority:
    """A root CA and its issuing CAs, kept in one folder.

    Attributes:
        directory: The folder.
        register: What it has issued and revoked.
    """

    def __init__(self, directory: Path) -> None:
        """Open the folder.

        Raises:
            IdentityError: There is no CA, or a key or certificate cannot be read.
        """
        if not (directory / ROOT_FILE).is_file():
            raise IdentityError(
                f"{directory}: there is no CA; `eskin pki init --dir {directory}` makes one"
            )
        self.directory = directory
        self.register = IssuanceRegister(directory)
        self._turn = ReentrantLock(directory / LEDGER)
        self._lists = RevocationLists(directory, self.register, self._turn)
        for kind in IdentityKind:
            load_issuers(directory, kind)

    @classmethod
    def open(cls, directory: Path) -> Self:
        """Open the folder; make a fresh authority where there is none, and lists that are due.

        Raises:
            IdentityError: It cannot be read or written.
        """
        create_ca(directory)
        authority = cls(directory)
        for kind in IdentityKind:
            authority.refresh_revocations(kind)
        return authority

    @classmethod
    def create(cls, directory: Path) -> Self:
        """Make a fresh authority where there is none.

        Raises:
            IdentityError: There is one, or the folder cannot be written.
        """
        if not create_ca(directory):
            raise IdentityError(
                f"{directory}: there is a CA already, which stays as it is; "
                "choose another folder for a new one"
            )
        return cls.open(directory)

    def changing(self) -> AbstractContextManager[None]:
        """Lock this CA against other threads and processes.

        A caller that looks at the CA and then issues a certificate holds the lock for both.

        Raises:
            LockedError: Another writer held the lock for too long.
            IdentityError: The folder cannot be written.
        """
        return self._turn.take()

    def issue(
        self,
        kind: IdentityKind,
        name: str,
        key: ec.EllipticCurvePublicKey,
        *,
        site: str = "",
        hosts: Sequence[str] = (),
        lifetime: timedelta = LEAF_LIFETIME,
        now: datetime | None = None,
    ) -> tuple[x509.Certificate, ...]:
        """Issue a certificate.

        Args:
            kind: Kind of the identity.
            name: Common name, see `eskin.identity.identity_kind`.
            key: The identity's public key.
            site: The site of a node or gateway, such as ``site.main``; empty for other kinds.
            hosts: DNS names and addresses of a server.
            lifetime: How long it is valid.
            now: Start of its validity; the present by default.

        Returns:
            The certificate, then the issuing CA's.

        Raises:
            IdentityError: The name is none of that kind, or was issued to another site; the site
                is missing; or the key was revoked.
        """
        kind.require_name(name)
        kind.require_site(site)
        with self.changing():
            self.register.require_site(name, site)
            self.register.require_unrevoked(key)
            issuer = self.issuer(kind, name)
            certificate = leaf_certificate(
                kind,
                name,
                key,
                site=site,
                hosts=hosts,
                signer=issuer.key,
                not_before=now or datetime.now(UTC),
                lifetime=lifetime,
            )
            self.register.add(certificate, issuer.certificate)
        return certificate, issuer.certificate

    def issuer(self, kind: IdentityKind, name: str) -> Issuer:
        """Who issues to a name now; read each time, as another process may have made a new one."""
        standing = load_issuers(self.directory, kind)
        return known_issuer(self.directory, standing) if name == CA_SERVICE else standing[0]

    def stands(self, issuer: x509.Certificate, kind: IdentityKind) -> bool:
        """Whether an issuing CA is one of a kind's, and not retired."""
        return any(issuer == each.certificate for each in load_issuers(self.directory, kind))

    def latest(self, name: str) -> tuple[x509.Certificate, ...] | None:
        """The chain last issued to a name; ``None`` if there is none, or it was revoked."""
        return self.register.latest(name)

    def issued(self) -> list[Issued]:
        """All certificates ever issued, the latest word on each, in order of issue."""
        return self.register.entries()

    def is_revoked(self, certificate: x509.Certificate) -> bool:
        """Whether a certificate was revoked, as the ledger or the list that stands says.

        Raises:
            IdentityError: It is of no kind.
        """
        if self.register.is_revoked(certificate):
            return True
        return self._lists.holds(issuer_kind(certificate), certificate)

    def revoke(self, name: str) -> list[Issued]:
        """Revoke all certificates of a name, and write its kind's revocation list anew.

        Once it returned, no certificate that was issued to the name before, or renewed from one, is
        trusted by who has the list. Of a name that was revoked before, the list is written again,
        as the first time may have been cut off.

        Returns:
            What stood until now; nothing if all was revoked before.

        Raises:
            LockedError: Another writer held the CA's lock for too long.
            IdentityError: None was ever issued to that name, or the folder cannot be written.
        """
        with self.changing():
            revoked = self.register.revoke(name)
        # Whatever list is written from here on holds them, so others may go on meanwhile.
        for kind in sorted({entry.kind for entry in self.issued() if entry.name == name}):
            self._lists.publish(IdentityKind(kind))
        return revoked

    def write_revocations(self, kind: IdentityKind) -> Path:
        """Sign the kind's revocation list and give its path.

        The file holds the certificate of each issuing CA, then the list that this one signed.
        """
        self._lists.write(kind)
        return self.revocations_file(kind)

    def is_published(self, kind: IdentityKind) -> bool:
        """Whether each issuing CA of a kind that stands has signed the kind's list."""
        return self._lists.is_complete(kind)

    def must_refresh(self, kind: IdentityKind) -> bool:
        """Whether the kind's list is a day old, or lacks who was revoked, or a CA that issues."""
        return self._lists.is_due(kind)

    def refresh_revocations(self, kind: IdentityKind) -> Path:
        """Sign the kind's list anew if it must be, and give its path."""
        if self.must_refresh(kind):
            self._lists.publish(kind)
        return self.revocations_file(kind)

    def rotate(self, kind: IdentityKind) -> None:
        """Make a new issuing CA, which issues from now on; what the old one issued still passes.

        Goes on where it was cut off.

        Raises:
            IdentityError: One is being replaced already, or the root's key is not here.
        """
        with self.changing():
            if len(load_issuers(self.directory, kind)) == 1:
                found_issuer(self.directory, kind, root_key(self.directory, self.roots[0]))
            elif self.is_published(kind):
                raise IdentityError(
                    f"the {kind} CA is being replaced already; end that first: `eskin pki retire`"
                )
            self.write_revocations(kind)

    def dependants(self, kind: IdentityKind) -> list[str]:
        """Names whose newest standing certificate is from an issuing CA that is being replaced."""
        current = load_issuers(self.directory, kind)[0].serial
        now = datetime.now(UTC)
        newest = {entry.name: entry for entry in self.issued() if entry.kind == kind}
        return sorted(
            entry.name
            for entry in newest.values()
            if entry.issuer != current
            and entry.name != CA_SERVICE  # it looks after itself
            and entry.revoked is None
            and datetime.fromisoformat(entry.expires) > now
        )

    def retire(self, kind: IdentityKind) -> None:
        """End the issuing CA that was replaced, and all certificates of it.

        Goes on where it was cut off.

        Raises:
            IdentityError: None is being replaced, or the root is, which ends them all.
        """
        with self.changing():
            if is_replaced(self.directory):
                raise IdentityError("the root is being replaced; see `eskin pki retire --root`")
            issuers = load_issuers(self.directory, kind)
            over = len(issuers) == 1 and self.is_published(kind)
            if over and not has_leftovers(self.directory, kind):
                raise IdentityError(f"no {kind} CA is being replaced; see `eskin pki rotate`")
            retire_issuers(self.directory, kind, issuers)
            self.write_revocations(kind)

    def anchor_file(self, kind: IdentityKind) -> Path:
        """The file with the kind's anchors, for a TLS server that takes only this kind."""
        return self.directory / f"{kind}.anchor.pem"

    def revocations_file(self, kind: IdentityKind) -> Path:
        """The file with the kind's revocation list."""
        return self._lists.file(kind)

    @property
    def root_file(self) -> Path:
        """The file with the standing roots' certificates."""
        return self.directory / ROOT_FILE

    @property
    def roots(self) -> tuple[x509.Certificate, ...]:
        """The standing roots, the one that issues first; read each time.

        Raises:
            AuthorityError: They cannot be read.
        """
        try:
            return load_certificates(self.root_file)
        except IdentityError as error:
            raise AuthorityError(str(error)) from error


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
