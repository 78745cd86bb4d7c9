"""Replacing the root CA under way, in three steps with time between them.

First the new root, and an issuing CA of each kind under it, come to be trusted everywhere and issue
nothing. Then they issue, and all parties renew. At last the old ones are retired. So no party ever
shows a certificate to a peer that does not trust it yet.
"""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING, Final

from eskin.errors import IdentityError
from eskin.identity.certificates import pem
from eskin.identity.identity import ROOT_FILE, load_certificates, write_whole
from eskin.identity.identity_kind import IdentityKind
from eskin.identity.issuing_ca import found_issuer, load_issuers, promote_issuer, retire_issuers
from eskin.identity.roots import found_root, is_issued_by, newer_root, retire_root, root_key

if TYPE_CHECKING:
    from eskin.identity.ca import CertificateAuthority

SPREAD: Final = timedelta(minutes=5)
"""Time in which running clients fetch a new root: they poll every second, or as configured."""


class RootRotation:
    """Of one CA.

    Args:
        authority: The CA.
    """

    def __init__(self, authority: CertificateAuthority) -> None:
        self._authority = authority
        self._directory = authority.directory

    def begin(self) -> None:
        """Make the new root and its issuing CAs; goes on where it was cut off.

        Raises:
            IdentityError: A CA is being replaced already, or the root's key is not here.
        """
        with self._authority.changing():
            self._begin()

    def _begin(self) -> None:
        standby = len(load_certificates(self._directory / ROOT_FILE)) > 1
        single = [kind for kind in IdentityKind if len(load_issuers(self._directory, kind)) == 1]
        done = not single and all(self._authority.is_published(kind) for kind in IdentityKind)
        if (standby and done) or (not standby and len(single) < len(IdentityKind)):
            raise IdentityError(
                "a CA is being replaced already; end that first: `eskin pki retire`"
            )
        if not standby:
            found_root(self._directory)
        signer = root_key(self._directory, newer_root(self._directory))
        for kind in single:
            found_issuer(self._directory, kind, signer, standby=True)
        for kind in IdentityKind:
            self._authority.write_revocations(kind)

    def age(self) -> timedelta:
        """Since when the new root has been there.

        Raises:
            IdentityError: No root is being replaced.
        """
        changed = (self._directory / ROOT_FILE).stat().st_mtime
        newer_root(self._directory)
        return datetime.now(UTC) - datetime.fromtimestamp(changed, UTC)

    def switch(self) -> None:
        """Let the new root's CAs issue; goes on where it was cut off.

        Raises:
            IdentityError: No root is being replaced, or not all of its CAs are made.
        """
        with self._authority.changing():
            self._switch()

    def _switch(self) -> None:
        new = newer_root(self._directory)
        for kind in IdentityKind:
            first, *others = load_issuers(self._directory, kind)
            if is_issued_by(first.certificate, new):
                continue
            if not others:
                raise IdentityError(f"no new {kind} CA yet: `eskin pki rotate --root` again")
            promote_issuer(self._directory, kind)
        roots = load_certificates(self._directory / ROOT_FILE)
        old = [root for root in roots if root != new]
        write_whole(self._directory / ROOT_FILE, pem([new, *old]))

    def dependants(self) -> list[str]:
        """Names whose newest standing certificate leads to the old root."""
        return sorted(name for kind in IdentityKind for name in self._authority.dependants(kind))

    def retire(self) -> None:
        """End the old root, its issuing CAs, and all certificates of them.

        Raises:
            IdentityError: No root is being replaced, or the new one does not issue yet.
        """
        with self._authority.changing():
            self._retire()

    def _retire(self) -> None:
        new = newer_root(self._directory)
        if load_certificates(self._directory / ROOT_FILE)[0] != new:
            raise IdentityError("the new root does not issue yet; see `eskin pki switch`")
        for kind in IdentityKind:
            retire_issuers(self._directory, kind, load_issuers(self._directory, kind))
            self._authority.write_revocations(kind)
        retire_root(self._directory)
