"""Client authentication by certificates of our CAs that are not revoked."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING

from cryptography import x509

from eskin.demo.broker.access import Party
from eskin.errors import UntrustedCertificateError
from eskin.identity import ChainVerifier, IdentityKind, der
from eskin.identity.identity import ROOT_FILE

if TYPE_CHECKING:
    from pathlib import Path

log = logging.getLogger(__name__)


class ClientAuth:
    """Checks certificates against the CA folder's revocation lists, which may change meanwhile.

    Args:
        authority: The CA's folder: ``root.pem`` and ``KIND.crl.pem`` are read, no key.

    Raises:
        IdentityError: A certificate or list is missing or cannot be used.
    """

    def __init__(self, authority: Path) -> None:
        self._trust = ChainVerifier.following(authority / ROOT_FILE)
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
        """Read the lists again. Returns whether one changed. A bad list changes nothing."""
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
        shown = certificate or b""
        issuer = self._trust.issuer_of(x509.load_der_x509_certificate(shown), party.kind)
        self._trust.verify([shown, der(issuer)], party.kind)
        return party

    def _take_over(self, kind: IdentityKind) -> bool:
        data = self._lists[kind].read_bytes()
        if data == self._seen.get(kind):
            return False
        self._trust.revocations(kind, data)
        self._seen[kind] = data
        return True
