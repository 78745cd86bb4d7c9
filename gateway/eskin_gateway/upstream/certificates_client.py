"""Presenting nodes' certificates to the cloud, which takes nothing of a node before."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, Protocol

import cbor2
import orjson

from eskin.errors import CloudError
from eskin_gateway.upstream.cloud_client import as_agreed

if TYPE_CHECKING:
    from collections.abc import Collection

    from eskin_gateway.spool.batch import Sender
    from eskin_gateway.spool.spool import Spool
    from eskin_gateway.upstream.cloud_client import CloudClient

_AT_ONCE: Final = 100


class Certificates(Protocol):
    """What the gateway needs to have the cloud know its nodes."""

    def has(self, node: str) -> bool:
        """Whether a node's certificate is here.

        Raises:
            SpoolError: The spool cannot be read.
        """

    def present(self, nodes: Collection[str]) -> dict[str, str]:
        """Present certificates of nodes.

        Returns:
            Why some are refused, by node; the cloud knows the others now.

        Raises:
            CloudError: The cloud did not answer as agreed.
            SpoolError: The spool cannot be read.
        """


class HttpsCertificates:
    """Over HTTPS, each node's certificate as the spool remembers it.

    Args:
        client: The way to the cloud.
        spool: Remembers the chain that each node used last.
    """

    def __init__(self, client: CloudClient, spool: Spool) -> None:
        self._client = client
        self._spool = spool

    def has(self, node: str) -> bool:
        """See `Certificates.has`."""
        return self._chain(node) is not None

    def present(self, nodes: Collection[str]) -> dict[str, str]:
        """See `Certificates.present`."""
        chains = {node: self._chain(node) for node in nodes}
        refused = {
            node: "the gateway has no certificate of it; let the node connect"
            for node, chain in chains.items()
            if chain is None
        }
        known = [(node, chain) for node, chain in chains.items() if chain is not None]
        for begin in range(0, len(known), _AT_ONCE):
            some = known[begin : begin + _AT_ONCE]
            reasons = self._post([[chain.leaf, chain.issuer] for _, chain in some])
            for (node, _), reason in zip(some, reasons, strict=True):
                if reason is not None:
                    refused[node] = reason
        return refused

    def _chain(self, node: str) -> Sender | None:
        record = self._spool.node(node)
        if record is None or record.thumbprint is None:
            return None
        return self._spool.sender(record.thumbprint)

    def _post(self, chains: list[list[bytes]]) -> list[str | None]:
        answer = self._client.post("certificates", cbor2.dumps(chains))
        with as_agreed(answer):
            reasons = [item["reason"] for item in orjson.loads(answer)["items"]]
        if len(reasons) != len(chains):
            raise CloudError(f"the cloud answered for {len(reasons)} of {len(chains)} chains")
        return [None if reason is None else str(reason)[:200] for reason in reasons]
