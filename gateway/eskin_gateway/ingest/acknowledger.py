"""The gateway's word to nodes: what is durable, sealed by the site's key."""

from __future__ import annotations

from typing import TYPE_CHECKING

from eskin.wire.messages import Acknowledgement, Position
from eskin.wire.sequence_set import SequenceRanges
from eskin.wire.topics import Stream, node_topic

if TYPE_CHECKING:
    from collections.abc import Iterable

    from cryptography import x509

    from eskin_gateway.spool.sealer_cache import SealerCache


class Acknowledger:
    """Seals acknowledgements.

    Args:
        sealer_cache: Seal for nodes.
    """

    def __init__(self, sealer_cache: SealerCache) -> None:
        self._sealer_cache = sealer_cache

    def seal(
        self,
        node: str,
        positions: Iterable[Position],
        *,
        to: x509.Certificate,
        named: bytes,
        time: int,
        watched: int = 0,
    ) -> tuple[str, bytes]:
        """Topic and sealed bytes of one acknowledgement.

        Args:
            node: Who is answered.
            positions: What is durable.
            to: The node's certificate.
            named: Its thumbprint.
            time: The gateway's clock, UTC ns.
            watched: ms for which somebody is expected to look at the node's data.
        """
        boots: dict[int, SequenceRanges] = {}
        for position in positions:
            boots.setdefault(position.boot, SequenceRanges()).add(position.sequence)
        spans = tuple((boot, first, last) for boot in sorted(boots) for first, last in boots[boot])
        topic = node_topic(node, Stream.ACKS)
        plaintext = Acknowledgement(time, spans, watched).encode()
        return topic, self._sealer_cache.seal(plaintext, topic=topic, to=to, named=named)
