"""Trust in nodes, with a revocation list that may change under way."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING, Final

from eskin.errors import UntrustedCertificateError
from eskin.identity import IdentityKind
from eskin.identity.version import version

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from cryptography import x509

    from eskin.identity import Trust
    from eskin.identity.version import Version

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
        self._seen: Version | None = None
        self._loaded = False
        self.fault: str | None = None

    def refresh(self, now: float) -> bool:
        """Look for a changed list, at most once a second; tells whether one was taken over.

        Args:
            now: Monotonic seconds.
        """
        if self._path is None or now < self._looked + _LOOK_S:
            return False
        self._looked = now
        try:
            seen = version(self._path)
            if seen == self._seen:
                return False
            self._trust.revocations(IdentityKind.NODE, self._path.read_bytes())
        except OSError as error:
            self._complain(f"revocation list {self._path} cannot be read: {error.strerror}")
            return False
        except UntrustedCertificateError as error:
            self._complain(f"revocation list {self._path} cannot be used: {error}")
            return False
        self._seen = seen
        self._loaded = True
        self.fault = None
        log.info("revocation list taken over: path=%s", self._path)
        return True

    def verify(self, chain: Sequence[bytes]) -> x509.Certificate:
        """Verify a node's chain.

        Raises:
            UntrustedCertificateError: As `Trust.verify`, or there is no usable revocation list yet.
        """
        if self._path is not None and not self._loaded:
            raise UntrustedCertificateError(self.fault or "no revocation list yet")
        return self._trust.verify(chain, IdentityKind.NODE)

    def require_good(self, leaf: x509.Certificate, issuer: x509.Certificate) -> None:
        """Judge a verified pair again.

        Raises:
            UntrustedCertificateError: As `Trust.require_good`.
        """
        self._trust.require_good(leaf, issuer, IdentityKind.NODE)

    def _complain(self, fault: str) -> None:
        if fault != self.fault:
            log.error("%s; the last good list stays, without one no node is trusted", fault)
        self.fault = fault
