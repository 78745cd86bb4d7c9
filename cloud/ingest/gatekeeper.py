"""Which gateways are ours: their chains, and which of them were revoked."""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING

from eskin.errors import UntrustedCertificateError
from eskin.identity import IdentityKind

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from cryptography import x509

    from eskin.identity import Trust


class Gatekeeper:
    """Verifies gateways' chains; with a revocation list, never without it.

    Args:
        trust: Verifies chains.
        revocations: The gateways' list (PEM), read again when the file changes.
    """

    def __init__(self, trust: Trust, *, revocations: Path | None) -> None:
        self._trust = trust
        self._revocations = revocations
        self._read: tuple[int, int, int] | None = None
        self._lock = threading.Lock()

    def verify(self, chain: Sequence[bytes]) -> x509.Certificate:
        """Verify a chain of DER certificates, the gateway's own first.

        Raises:
            UntrustedCertificateError: It is no gateway of ours, or no more.
        """
        if self._revocations is not None:
            with self._lock:
                self._refresh(self._revocations)
        return self._trust.verify(chain, IdentityKind.GATEWAY)

    def _refresh(self, path: Path) -> None:
        try:
            found = path.stat()
            version = found.st_mtime_ns, found.st_size, found.st_ino
            if version == self._read:
                return
            self._trust.revocations(IdentityKind.GATEWAY, path.read_bytes())
        except OSError as error:
            raise UntrustedCertificateError(
                f"{path}: the revocation list cannot be read, so nobody is let in: {error.strerror}"
            ) from error
        self._read = version
