"""The site's sealers, one for each node's certificate."""

from __future__ import annotations

from collections import OrderedDict
from typing import TYPE_CHECKING

from eskin.envelope import Sealer

if TYPE_CHECKING:
    from cryptography import x509

    from eskin.identity import Identity


class Sealers:
    """Seals what the gateway says to nodes. Only for one thread.

    Args:
        site: The site's identity.
        capacity: How many nodes' keys are remembered.
    """

    def __init__(self, site: Identity, *, capacity: int = 4096) -> None:
        self._site = site
        self._capacity = capacity
        self._sealers: OrderedDict[bytes, Sealer] = OrderedDict()

    def seal(self, plaintext: bytes, *, topic: str, to: x509.Certificate, named: bytes) -> bytes:
        """Seal a message.

        Args:
            plaintext: The message.
            topic: Where it will be published.
            to: The node's certificate.
            named: Its thumbprint.
        """
        return self._sealer(to, named).seal(plaintext, topic=topic)

    def _sealer(self, to: x509.Certificate, named: bytes) -> Sealer:
        sealer = self._sealers.get(named)
        if sealer is None:
            # A sealer that is made again draws a fresh salt, so that no nonce comes twice.
            sealer = self._sealers[named] = Sealer(self._site, to)
            if len(self._sealers) > self._capacity:
                self._sealers.popitem(last=False)
        self._sealers.move_to_end(named)
        return sealer
