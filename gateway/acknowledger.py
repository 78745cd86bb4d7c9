"""The gateway's word to nodes: what is durable, sealed by the site's key."""

from __future__ import annotations

from collections import OrderedDict
from typing import TYPE_CHECKING

from eskin.envelope import Sealer
from eskin.messages import Acknowledgement, Position
from eskin.sequences import SequenceRanges
from eskin.topics import Stream, node_topic

if TYPE_CHECKING:
    from collections.abc import Iterable

    from cryptography import x509

    from eskin.identity import Identity


class Acknowledger:
    """Seals acknowledgements.

    Args:
        site: The site's identity.
        capacity: How many nodes' keys are remembered.
    """

    def __init__(self, site: Identity, *, capacity: int = 4096) -> None:
        self._site = site
        self._capacity = capacity
        self._sealers: OrderedDict[bytes, Sealer] = OrderedDict()

    def seal(
        self,
        node: str,
        positions: Iterable[Position],
        *,
        to: x509.Certificate,
        named: bytes,
        time: int,
    ) -> tuple[str, bytes]:
        """Topic and sealed bytes of one acknowledgement.

        Args:
            node: Who is answered.
            positions: What is durable.
            to: The node's certificate.
            named: Its thumbprint.
            time: The gateway's clock, UTC ns.
        """
        boots: dict[int, SequenceRanges] = {}
        for position in positions:
            boots.setdefault(position.boot, SequenceRanges()).add(position.sequence)
        spans = tuple((boot, first, last) for boot in sorted(boots) for first, last in boots[boot])
        topic = node_topic(node, Stream.ACKS)
        sealer = self._sealer(to, named)
        return topic, sealer.seal(Acknowledgement(time, spans).encode(), topic=topic)

    def _sealer(self, to: x509.Certificate, named: bytes) -> Sealer:
        sealer = self._sealers.get(named)
        if sealer is None:
            # A sealer that is made again draws a fresh salt, so that no nonce comes twice.
            sealer = self._sealers[named] = Sealer(self._site, to)
            if len(self._sealers) > self._capacity:
                self._sealers.popitem(last=False)
        self._sealers.move_to_end(named)
        return sealer
