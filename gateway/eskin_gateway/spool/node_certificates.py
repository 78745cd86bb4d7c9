"""Certificates of senders: verified when introduced, remembered durably, judged again at use."""

from __future__ import annotations

import hashlib
import time
from collections import OrderedDict
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from cryptography import x509

from eskin.errors import UntrustedCertificateError
from eskin.identity import IdentityKind, common_name, der, site_of, thumbprint
from eskin_gateway.spool.batch import Sender

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from eskin.identity import ChainVerifier, RevocationFile
    from eskin_gateway.spool.spool import Spool

RECHECK_S: Final = 10.0
"""For how long one judgement is good; a new revocation list ends it at once."""


@dataclass(slots=True)
class _Known:
    """A pair whose signatures are verified.

    ``judged`` is when it was last found valid and not revoked, ``kept`` whether the spool has it.
    """

    leaf: x509.Certificate
    issuer: x509.Certificate
    judged: float
    kept: bool = False


class NodeCertificates:
    """Finds the verified certificate of a sender by its thumbprint.

    Args:
        spool: Where certificates are remembered.
        trust: Leads to the root.
        revocations: The nodes' revocation list, which the trust follows.
        site: The gateway's own; nodes of another one are refused.
        capacity: How many verified certificates are kept in memory.
        clock: Monotonic seconds.
    """

    def __init__(
        self,
        spool: Spool,
        trust: ChainVerifier,
        *,
        revocations: RevocationFile,
        site: str,
        capacity: int = 4096,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._spool = spool
        self._trust = trust
        self._revocations = revocations
        self._site = site
        self._capacity = capacity
        self._clock = clock
        self._now = clock()
        self._listed = float("-inf")
        self._known: OrderedDict[bytes, _Known] = OrderedDict()
        self._fresh: dict[bytes, Sender] = {}

    def refresh(self) -> None:
        """Look at the clock and at the revocation list, once for many messages."""
        self._now = self._clock()
        if self._revocations.refresh():
            self._listed = self._now

    def find(self, named: bytes) -> x509.Certificate | None:
        """The certificate with a thumbprint; ``None`` where it was never introduced.

        Raises:
            UntrustedCertificateError: It is not valid now, or revoked.
        """
        known = self._known.get(named)
        if known is not None:
            return self._judge(known)
        sender = self._fresh.get(named) or self._spool.sender(named)
        if sender is None:
            return None
        return self._verify((sender.leaf, sender.issuer)).leaf

    def introduce(self, chain: Sequence[bytes], node: str) -> None:
        """Take over the chain that a node's status carries.

        Raises:
            UntrustedCertificateError: It is no valid chain of that node.
        """
        known = self._known.get(hashlib.sha256(chain[0]).digest()) if chain else None
        if known is None or list(chain) != [der(known.leaf), der(known.issuer)]:
            known = self._verify(chain)
        leaf = self._judge(known)
        if common_name(leaf) != node:
            raise UntrustedCertificateError(
                f"certificate of {common_name(leaf)!r} on the topic of {node!r}"
            )
        if not known.kept:
            self._keep(known)

    def _keep(self, known: _Known) -> None:
        named = thumbprint(known.leaf)
        expires = int(known.leaf.not_valid_after_utc.timestamp())
        sender = Sender(named, expires, der(known.leaf), der(known.issuer))
        if self._spool.sender(named) != sender:  # there is none, or a damaged one
            self._fresh[named] = sender
        known.kept = True

    def fresh(self) -> list[Sender]:
        """Senders to be remembered with the next commit."""
        return list(self._fresh.values())

    def remembered(self) -> None:
        """The senders that `fresh` gave are durable now."""
        self._fresh.clear()

    def _judge(self, known: _Known) -> x509.Certificate:
        """What may have changed since it was verified: the time, and the revocations."""
        if known.judged < self._listed or self._now >= known.judged + RECHECK_S:
            self._trust.require_good(known.leaf, known.issuer, IdentityKind.NODE)
            known.judged = self._now
        return known.leaf

    def _verify(self, chain: Sequence[bytes]) -> _Known:
        self._revocations.require()
        leaf = self._trust.verify(chain, IdentityKind.NODE)
        if site_of(leaf) != self._site:
            raise UntrustedCertificateError(
                f"{common_name(leaf)} is a node of {site_of(leaf)}, not of {self._site}"
            )
        known = _Known(leaf, x509.load_der_x509_certificate(chain[1]), self._now)
        named = thumbprint(leaf)
        self._known[named] = known
        self._known.move_to_end(named)
        if len(self._known) > self._capacity:
            self._known.popitem(last=False)
        return known
