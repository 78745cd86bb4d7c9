"""The site's sealers, one for each node's certificate."""

from __future__ import annotations

from collections import OrderedDict
from typing import TYPE_CHECKING

from eskin.wire.envelope import Sealer

if TYPE_CHECKING:
    from collections.abc import Callable

    from cryptography import x509

    from eskin.identity import Identity


class SealerCache:
    """Seals what the gateway says to nodes. Only for one thread.

    Args:
        site: Gives the site's identity that answers a node, named by its thumbprint.
        capacity: How many nodes' keys are remembered.
    """

    def __init__(self, site: Callable[[bytes], Identity], *, capacity: int = 4096) -> None:
        self._site = site
        self._capacity = capacity
        self._sealer_cache: OrderedDict[tuple[bytes, bytes], Sealer] = OrderedDict()

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
        site = self._site(named)
        key = named, site.thumbprint
        sealer = self._sealer_cache.get(key)
        if sealer is None:
            # A sealer that is made again draws a fresh salt, so that no nonce comes twice.
            sealer = self._sealer_cache[key] = Sealer(site, to)
            if len(self._sealer_cache) > self._capacity:
                self._sealer_cache.popitem(last=False)
        self._sealer_cache.move_to_end(key)
        return sealer
