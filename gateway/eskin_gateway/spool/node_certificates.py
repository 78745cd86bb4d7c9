"""Certificates of nodes: verified once, stored durably, checked again at use."""

from __future__ import annotations

import hashlib
import time
from collections import OrderedDict
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from cryptography import x509

from eskin.errors import UntrustedCertificateError
from eskin.identity import IdentityKind, common_name, der, site_of, thumbprint
from eskin_gateway.spool.batch import NodeCertificate

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from eskin.identity import ChainVerifier, RevocationFile
    from eskin_gateway.spool.spool import Spool

_RECHECK_S: Final = 10.0
"""How long a check is valid. A new revocation list ends it at once."""


@dataclass(slots=True)
class _Verified:
    """A chain whose signatures are verified.

    Attributes:
        checked: When it was last found valid and not revoked.
        stored: Whether the spool has it, or gets it with the next commit.
    """

    leaf: x509.Certificate
    issuer: x509.Certificate
    checked: float
    stored: bool = False


class NodeCertificates:
    """Finds a node's verified certificate by its thumbprint.

    Args:
        spool: Stores certificates.
        verifier: Verifies chains up to the root.
        revocations: The nodes' revocation list, which the verifier uses.
        site: The gateway's site. Nodes of other sites are rejected.
        capacity: Most verified certificates in memory.
        clock: Monotonic seconds.
    """

    def __init__(
        self,
        spool: Spool,
        verifier: ChainVerifier,
        *,
        revocations: RevocationFile,
        site: str,
        capacity: int = 4096,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._spool = spool
        self._verifier = verifier
        self._revocations = revocations
        self._site = site
        self._capacity = capacity
        self._clock = clock
        self._now = clock()
        self._revocations_read = float("-inf")
        self._verified: OrderedDict[bytes, _Verified] = OrderedDict()
        self._uncommitted: dict[bytes, NodeCertificate] = {}

    def refresh(self) -> None:
        """Read the clock and the revocation list, once for many messages."""
        self._now = self._clock()
        if self._revocations.refresh():
            self._revocations_read = self._now

    def find(self, named: bytes) -> x509.Certificate | None:
        """Find the certificate with a thumbprint; ``None`` if it is unknown.

        Raises:
            UntrustedCertificateError: It is expired or revoked.
        """
        verified = self._verified.get(named)
        if verified is not None:
            return self._check(verified)
        stored = self._uncommitted.get(named) or self._spool.certificate(named)
        return None if stored is None else self._verify((stored.leaf, stored.issuer)).leaf

    def find_latest(self, node: str) -> tuple[x509.Certificate, bytes] | None:
        """Find the trusted certificate that a node used last, and its thumbprint."""
        state = self._spool.node(node)
        if state is None or state.thumbprint is None:
            return None
        self.refresh()
        try:
            certificate = self.find(state.thumbprint)
        except UntrustedCertificateError:
            return None
        return None if certificate is None else (certificate, state.thumbprint)

    def introduce(self, chain: Sequence[bytes], node: str) -> None:
        """Add the chain of a node's status.

        Raises:
            UntrustedCertificateError: It is no valid chain of that node.
        """
        verified = self._verified.get(hashlib.sha256(chain[0]).digest()) if chain else None
        if verified is None or list(chain) != [der(verified.leaf), der(verified.issuer)]:
            verified = self._verify(chain)
        leaf = self._check(verified)
        if common_name(leaf) != node:
            raise UntrustedCertificateError(
                f"certificate of {common_name(leaf)!r} on the topic of {node!r}"
            )
        if not verified.stored:
            self._store(verified)

    def _store(self, verified: _Verified) -> None:
        named = thumbprint(verified.leaf)
        expires = int(verified.leaf.not_valid_after_utc.timestamp())
        certificate = NodeCertificate(named, expires, der(verified.leaf), der(verified.issuer))
        if self._spool.certificate(named) != certificate:  # it is missing or damaged
            self._uncommitted[named] = certificate
        verified.stored = True

    def uncommitted(self) -> list[NodeCertificate]:
        """Certificates for the next commit."""
        return list(self._uncommitted.values())

    def committed(self) -> None:
        """Note that what `uncommitted` returned is durable."""
        self._uncommitted.clear()

    def _check(self, verified: _Verified) -> x509.Certificate:
        """Check what may have changed since it was verified: time and revocations."""
        if verified.checked < self._revocations_read or self._now >= verified.checked + _RECHECK_S:
            self._verifier.require_good(verified.leaf, verified.issuer, IdentityKind.NODE)
            verified.checked = self._now
        return verified.leaf

    def _verify(self, chain: Sequence[bytes]) -> _Verified:
        self._revocations.require()
        leaf = self._verifier.verify(chain, IdentityKind.NODE)
        if site_of(leaf) != self._site:
            raise UntrustedCertificateError(
                f"{common_name(leaf)} is a node of {site_of(leaf)}, not of {self._site}"
            )
        verified = _Verified(leaf, x509.load_der_x509_certificate(chain[1]), self._now)
        named = thumbprint(leaf)
        self._verified[named] = verified
        self._verified.move_to_end(named)
        if len(self._verified) > self._capacity:
            self._verified.popitem(last=False)
        return verified
