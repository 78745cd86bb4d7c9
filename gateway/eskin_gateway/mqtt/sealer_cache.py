"""Seals messages for nodes, with a cached sealer for each node's certificate.

A new sealer a message, which derives its key, costs the gateway 1.13 to 1.25 times as much CPU
(``python -m benchmarks.gateway_lanes``).
"""

from __future__ import annotations

from collections import OrderedDict
from typing import TYPE_CHECKING

from eskin.wire.envelope import Sealer

if TYPE_CHECKING:
    from collections.abc import Callable

    from cryptography import x509

    from eskin.identity import Identity


class SealerCache:
    """Sealers by certificate, least recently used first. Not thread-safe.

    Args:
        find_site: Returns the site's identity for a node's thumbprint.
        capacity: Most sealers.
    """

    def __init__(self, find_site: Callable[[bytes], Identity], *, capacity: int = 4096) -> None:
        self._find_site = find_site
        self._capacity = capacity
        self._sealers: OrderedDict[tuple[bytes, bytes], Sealer] = OrderedDict()

    def seal(
        self, plaintext: bytes, *, topic: str, to: x509.Certificate, thumbprint: bytes
    ) -> bytes:
        """Seal a message.

        Args:
            plaintext: The message.
            topic: Where it will be published.
            to: The node's certificate.
            thumbprint: Its thumbprint.
        """
        site = self._find_site(thumbprint)
        key = thumbprint, site.thumbprint
        sealer = self._sealers.get(key)
        if sealer is None:
            # A new sealer draws a fresh salt, so no nonce repeats.
            sealer = self._sealers[key] = Sealer(site, to)
            if len(self._sealers) > self._capacity:
                self._sealers.popitem(last=False)
        self._sealers.move_to_end(key)
        return sealer.seal(plaintext, topic=topic)
