"""Who may come in: certificates of our CAs that nobody revoked."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING

from cryptography.hazmat.primitives.serialization import Encoding

from demo.broker.access import Party
from eskin.errors import UntrustedCertificateError
from eskin.identity import IdentityKind, Trust
from eskin.identity.identity import load_certificates

if TYPE_CHECKING:
    from pathlib import Path

    from cryptography import x509

log = logging.getLogger(__name__)


class Doorkeeper:
    """Checks certificates against the CA folder's revocation lists, which may change meanwhile.

    Args:
        root: The root that all chains lead to.
        authority: The CA's folder: ``KIND.pem`` and ``KIND.crl.pem`` are read, no key.

    Raises:
        IdentityError: A certificate or list is missing or cannot be used.
    """

    def __init__(self, root: x509.Certificate, authority: Path) -> None:
        self._trust = Trust(root)
        self._issuers = {
            kind: load_certificates(authority / f"{kind}.pem")[0] for kind in IdentityKind
        }
        self._lists = {kind: authority / f"{kind}.crl.pem" for kind in IdentityKind}
        self._seen: dict[IdentityKind, bytes] = {}
        for kind in IdentityKind:
            try:
                self._take_over(kind)
            except OSError as error:
                raise UntrustedCertificateError(
                    f"{self._lists[kind]}: revocation list cannot be read: {error.strerror}"
                ) from error

    def refresh(self) -> bool:
        """Read the lists again; tells whether one changed. A bad list changes nothing."""
        changed = False
        for kind, path in self._lists.items():
            try:
                changed |= self._take_over(kind)
            except (OSError, UntrustedCertificateError) as error:
                log.warning("revocation list not taken over: path=%s error=%s", path, error)
        return changed

    def admit(self, certificate: bytes | None) -> Party:
        """Who shows this certificate (DER), which TLS has verified.

        Raises:
            IdentityError: There is none, it is not one of eskin, or it was revoked.
        """
        party = Party.of(certificate)
        issuer = self._issuers[party.kind].public_bytes(Encoding.DER)
        self._trust.verify([certificate or b"", issuer], party.kind)
        return party

    def _take_over(self, kind: IdentityKind) -> bool:
        data = self._lists[kind].read_bytes()
        if data == self._seen.get(kind):
            return False
        self._trust.revocations(data, self._issuers[kind])
        self._seen[kind] = data
        return True
