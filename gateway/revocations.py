"""Trust in nodes, with a revocation list that may change under way."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING, Final

from cryptography import x509

from eskin.errors import UntrustedCertificateError

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from eskin.identity import IdentityKind, Trust

log = logging.getLogger(__name__)

_LOOK_S: Final = 1.0


class Revocations:
    """Verifies chains; a revocation list that is configured must be there, or nobody is trusted.

    Args:
        trust: Leads to the root.
        path: The list (PEM); ``None`` where none is configured.
    """

    def __init__(self, trust: Trust, path: Path | None) -> None:
        self._trust = trust
        self._path = path
        self._looked = float("-inf")
        self._seen: tuple[int, int, int] | None = None
        self._pending: bytes | None = None
        self._loaded = False
        self.fault: str | None = None

    def refresh(self, now: float) -> bool:
        """Look for a changed list, at most once a second; tells whether there is one.

        Args:
            now: Monotonic seconds.
        """
        if self._path is None or now < self._looked + _LOOK_S:
            return False
        self._looked = now
        try:
            found = self._path.stat()
            state = found.st_mtime_ns, found.st_size, found.st_ino
            if state == self._seen:
                return False
            self._pending = self._path.read_bytes()
        except OSError as error:
            self._complain(f"revocation list {self._path} cannot be read: {error.strerror}")
            return False
        self._seen = state
        return True

    def verify(self, chain: Sequence[bytes], kind: IdentityKind) -> x509.Certificate:
        """Verify a chain.

        Raises:
            UntrustedCertificateError: As `Trust.verify`, or there is no usable revocation list yet.
        """
        leaf = self._trust.verify(chain, kind)
        if self._path is None:
            return leaf
        if self._pending is not None:
            # Only a chain shows the CA that signs the list; this one was just verified.
            self._take_over(self._pending, x509.load_der_x509_certificate(chain[1]))
        if not self._loaded:
            raise UntrustedCertificateError(self.fault or "no revocation list yet")
        return self._trust.verify(chain, kind)

    def _take_over(self, data: bytes, issuer: x509.Certificate) -> None:
        self._pending = None
        try:
            self._trust.revocations(data, issuer)
        except UntrustedCertificateError as error:
            self._complain(f"revocation list {self._path} cannot be used: {error}")
            return
        self._loaded = True
        self.fault = None
        log.info("revocation list taken over: path=%s", self._path)

    def _complain(self, fault: str) -> None:
        if fault != self.fault:
            log.error("%s; the last good list stays, without one no node is trusted", fault)
        self.fault = fault
