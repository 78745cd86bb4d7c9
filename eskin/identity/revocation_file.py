"""A kind's revocation list as a file, which the process that fetches it may replace at any time."""

from __future__ import annotations

import logging
import threading
import time
from typing import TYPE_CHECKING, Final

from eskin.errors import UntrustedCertificateError
from eskin.runtime.files.stamp import version

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from eskin.identity.chain_verifier import ChainVerifier
    from eskin.identity.identity_kind import IdentityKind
    from eskin.runtime.files.stamp import Version

log = logging.getLogger(__name__)

_AGAIN_S: Final = 1.0
"""After so long a refused list is read again: its signer may be trusted by then."""


class RevocationFile:
    """Loads a revocation list whenever its file changes; keeps the last valid one.

    Args:
        verifier: Gets the list.
        kind: Whose list it is.
        path: The list (PEM); ``None`` where none is configured.
        clock: Monotonic seconds.

    Attributes:
        fault: Why the list in the file was not taken over; ``None`` if it was.
    """

    def __init__(
        self,
        verifier: ChainVerifier,
        kind: IdentityKind,
        path: Path | None,
        *,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._verifier = verifier
        self._kind = kind
        self._path = path
        self._clock = clock
        self._seen: Version | None = None
        self._looked = float("-inf")
        self._loaded = False
        self._lock = threading.Lock()
        self.fault: str | None = None

    def refresh(self) -> bool:
        """Take over a list that changed; gives whether one was."""
        if self._path is None:
            return False
        with self._lock:
            return self._look(self._path)

    def require(self) -> None:
        """Require that a list which is configured was taken over at least once.

        Raises:
            UntrustedCertificateError: None was.
        """
        if self._path is not None and not self._loaded:
            raise UntrustedCertificateError(
                f"{self.fault or f'{self._path}: not read yet'}; no {self._kind} is trusted "
                "without a revocation list"
            )

    def _look(self, path: Path) -> bool:
        try:
            seen = version(path)
            again = self.fault is not None and self._clock() >= self._looked + _AGAIN_S
            if seen == self._seen and not again:
                return False
            self._seen, self._looked = seen, self._clock()
            self._verifier.revocations(self._kind, path.read_bytes())
        except OSError as error:
            self._warn(f"{path}: the revocation list cannot be read: {error.strerror}")
            return False
        except UntrustedCertificateError as error:
            self._warn(f"{path}: the revocation list cannot be used: {error}")
            return False
        self._loaded, self.fault = True, None
        log.info("revocation list taken over: path=%s", path)
        return True

    def _warn(self, fault: str) -> None:
        if fault != self.fault:
            stays = f"the last good one stays; without one no {self._kind} is trusted"
            log.warning("%s; %s", fault, stays)
        self.fault = fault
