"""Which gateways and nodes are ours: their chains, and which of them were revoked."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Final

from eskin.identity import IdentityKind, RevocationFile

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from cryptography import x509

    from eskin.identity import ChainVerifier

_GOOD_S: Final = 1.0
"""For how long one judgement of a gateway is good; a new list ends it at once."""
_MOST: Final = 64


class GatewayTrust:
    """Verifies chains, where lists are configured never without one.

    Args:
        trust: Verifies chains.
        gateways: The gateways' revocation list (PEM).
        nodes: The nodes' revocation list (PEM).
        clock: Monotonic seconds.
    """

    def __init__(
        self,
        trust: ChainVerifier,
        *,
        gateways: Path | None = None,
        nodes: Path | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._trust = trust
        self._clock = clock
        self._gateways = RevocationFile(trust, IdentityKind.GATEWAY, gateways, clock=clock)
        self._nodes = RevocationFile(trust, IdentityKind.NODE, nodes, clock=clock)
        self._known: dict[tuple[bytes, ...], tuple[float, x509.Certificate]] = {}

    def verify(self, chain: Sequence[bytes]) -> x509.Certificate:
        """Verify a gateway's chain of DER certificates, its own first.

        Raises:
            UntrustedCertificateError: It is no gateway of ours, or no more.
        """
        if self._gateways.refresh():
            self._known.clear()
        self._gateways.require()
        # A gateway asks a hundred times a second, and two signatures take a millisecond.
        key, now = tuple(chain), self._clock()
        judged, leaf = self._known.get(key, (float("-inf"), None))
        if leaf is None or now >= judged + _GOOD_S:
            leaf = self._trust.verify(chain, IdentityKind.GATEWAY)
            if len(self._known) >= _MOST:
                self._known.clear()
            self._known[key] = now, leaf
        return leaf

    def verify_node(self, chain: Sequence[bytes]) -> x509.Certificate:
        """Verify a node's chain, which a gateway presents; it may have expired, as nodes sleep.

        Raises:
            UntrustedCertificateError: It is none of a node of ours, or was revoked.
        """
        self._nodes.refresh()
        self._nodes.require()
        return self._trust.verify_issued(chain, IdentityKind.NODE)
