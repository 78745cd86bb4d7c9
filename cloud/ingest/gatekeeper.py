"""Which gateways are ours: their chains, and which of them were revoked."""

from __future__ import annotations

import logging
import threading
import time
from typing import TYPE_CHECKING, Final

from eskin.errors import UntrustedCertificateError
from eskin.identity import IdentityKind
from eskin.identity.version import version

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from cryptography import x509

    from eskin.identity import Trust
    from eskin.identity.version import Version

log = logging.getLogger(__name__)

_GOOD_S: Final = 1.0
"""For how long one judgement is good, of a gateway and of a list; a new list ends it at once."""
_MOST: Final = 64


class Gatekeeper:
    """Verifies gateways' chains; with a revocation list, never without it.

    Where a list cannot be used, or is older, the last good one stays, until it ends.

    Args:
        trust: Verifies chains.
        revocations: The gateways' list (PEM), read again when the file changes.
        clock: Monotonic seconds.

    Attributes:
        fault: Why the list that lies there was not taken; ``None`` if it was.
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
        self._loaded = False
        self._seen: Version | None = None
        self._looked = float("-inf")
        self.fault: str | None = None
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
        """Take over a list that changed; one that was refused is tried again after a while.

        Raises:
            UntrustedCertificateError: There was none yet that can be used.
        """
        try:
            seen = version(path)
            if seen != self._seen or self._is_worth_another_look():
                self._seen, self._looked = seen, self._clock()
                self._trust.revocations(IdentityKind.GATEWAY, path.read_bytes())
                self._known.clear()
                self._loaded, self.fault = True, None
        except OSError as error:
            self._complain(f"{path}: the revocation list cannot be read: {error.strerror}")
        except UntrustedCertificateError as error:
            self._complain(f"{path}: the revocation list cannot be used: {error}")
        if not self._loaded:
            raise UntrustedCertificateError(f"{self.fault}; nobody is let in without one")

    def _is_worth_another_look(self) -> bool:
        """Whoever signed a list may be believed later, as when a new root comes after it."""
        return self.fault is not None and self._clock() >= self._looked + _GOOD_S

    def _complain(self, fault: str) -> None:
        if fault != self.fault:
            log.warning("%s; %s", fault, "the last good one stays" if self._loaded else "no other")
        self.fault = fault
