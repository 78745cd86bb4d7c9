"""Certificates of senders: verified when introduced, remembered durably, judged again at use."""

from __future__ import annotations

import time
from collections import OrderedDict
from typing import TYPE_CHECKING, Final

from eskin.errors import UntrustedCertificateError
from eskin.identity import common_name, der, thumbprint
from gateway.batch import Sender

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from cryptography import x509

    from gateway.revocations import Revocations
    from gateway.spool import Spool

RECHECK_S: Final = 10.0
"""For how long one verification is good; a new revocation list ends it at once."""


class Senders:
    """Finds the verified certificate of a sender by its thumbprint.

    Args:
        spool: Where certificates are remembered.
        revocations: The nodes' CA, root and revocation list.
        capacity: How many verified certificates are kept in memory.
        clock: Monotonic seconds.
    """

    def __init__(
        self,
        spool: Spool,
        revocations: Revocations,
        *,
        capacity: int = 4096,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._spool = spool
        self._revocations = revocations
        self._capacity = capacity
        self._clock = clock
        self._now = clock()
        self._known: OrderedDict[bytes, tuple[x509.Certificate, float]] = OrderedDict()
        self._fresh: dict[bytes, Sender] = {}

    def refresh(self) -> None:
        """Look at the clock and at the revocation list, once for many messages."""
        self._now = self._clock()
        if self._revocations.refresh(self._now):
            self._known.clear()

    def find(self, named: bytes) -> x509.Certificate | None:
        """The certificate with a thumbprint; ``None`` where it was never introduced.

        Raises:
            UntrustedCertificateError: It is not valid now, or revoked.
        """
        known = self._known.get(named)
        if known is not None and self._now < known[1]:
            return known[0]
        sender = self._fresh.get(named) or self._spool.sender(named)
        if sender is None:
            return None
        return self._verify((sender.leaf, sender.issuer))

    def introduce(self, chain: Sequence[bytes], node: str) -> None:
        """Take over the chain that a node's status carries.

        Raises:
            UntrustedCertificateError: It is no valid chain of that node.
        """
        leaf = self._verify(chain)
        if common_name(leaf) != node:
            raise UntrustedCertificateError(
                f"certificate of {common_name(leaf)!r} on the topic of {node!r}"
            )
        named = thumbprint(leaf)
        if self._spool.sender(named) is None:
            expires = int(leaf.not_valid_after_utc.timestamp())
            self._fresh[named] = Sender(named, expires, der(leaf), bytes(chain[1]))

    def fresh(self) -> list[Sender]:
        """Senders to be remembered with the next commit."""
        return list(self._fresh.values())

    def remembered(self) -> None:
        """The senders that `fresh` gave are durable now."""
        self._fresh.clear()

    def _verify(self, chain: Sequence[bytes]) -> x509.Certificate:
        leaf = self._revocations.verify(chain)
        named = thumbprint(leaf)
        self._known[named] = leaf, self._now + RECHECK_S
        self._known.move_to_end(named)
        if len(self._known) > self._capacity:
            self._known.popitem(last=False)
        return leaf
