"""Which gateways are ours: their chains, and which of them were revoked."""

from __future__ import annotations

import threading
import time
from typing import TYPE_CHECKING, Final

from eskin.errors import UntrustedCertificateError
from eskin.identity import IdentityKind

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from cryptography import x509

    from eskin.identity import Trust


_GOOD_S: Final = 1.0
"""For how long one judgement is good; a new revocation list ends it at once."""
_MOST: Final = 64


class Gatekeeper:
    """Verifies gateways' chains; with a revocation list, never without it.

    Args:
        trust: Verifies chains.
        revocations: The gateways' list (PEM), read again when the file changes.
        clock: Monotonic seconds.
    """

    def __init__(
        self,
        trust: Trust,
        *,
        revocations: Path | None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._trust = trust
        self._revocations = revocations
        self._clock = clock
        self._read: tuple[int, int, int] | None = None
        self._lock = threading.Lock()
        self._known: dict[tuple[bytes, ...], tuple[float, x509.Certificate]] = {}

    def verify(self, chain: Sequence[bytes]) -> x509.Certificate:
        """Verify a chain of DER certificates, the gateway's own first.

        Raises:
            UntrustedCertificateError: It is no gateway of ours, or no more.
        """
        if self._revocations is not None:
            with self._lock:
                self._refresh(self._revocations)
        # A gateway asks a hundred times a second, and two signatures take a millisecond.
        key, now = tuple(chain), self._clock()
        judged, leaf = self._known.get(key, (float("-inf"), None))
        if leaf is None or now >= judged + _GOOD_S:
            leaf = self._trust.verify(chain, IdentityKind.GATEWAY)
            if len(self._known) >= _MOST:
                self._known.clear()
            self._known[key] = now, leaf
        return leaf

    def _refresh(self, path: Path) -> None:
        try:
            found = path.stat()
            version = found.st_mtime_ns, found.st_size, found.st_ino
            if version == self._read:
                return
            self._known.clear()
            self._trust.revocations(IdentityKind.GATEWAY, path.read_bytes())
        except OSError as error:
            raise UntrustedCertificateError(
                f"{path}: the revocation list cannot be read, so nobody is let in: {error.strerror}"
            ) from error
        self._read = version
