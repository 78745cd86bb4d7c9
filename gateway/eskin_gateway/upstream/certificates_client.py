"""Registers node certificates with the cloud, which rejects messages of unknown nodes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import cbor2
import orjson

from eskin.errors import CloudError
from eskin_gateway.upstream.cloud_client import parsing

if TYPE_CHECKING:
    from collections.abc import Collection

    from eskin_gateway.spool.batch import NodeCertificate
    from eskin_gateway.spool.spool import Spool
    from eskin_gateway.upstream.cloud_client import CloudClient

_MAX_CHAINS: Final = 100


class CertificatesClient:
    """The cloud's ``certificates``.

    Args:
        client: Posts to the cloud.
        spool: Holds the chain that each node used last.
    """

    def __init__(self, client: CloudClient, spool: Spool) -> None:
        self._client = client
        self._spool = spool

    def has(self, node: str) -> bool:
        """Whether the gateway has a node's certificate.

        Raises:
            SpoolError: The spool cannot be read.
        """
        return self._chain(node) is not None

    def register(self, nodes: Collection[str]) -> dict[str, str]:
        """Register the certificates of nodes and return why some are rejected, by node.

        Raises:
            CloudError: The request failed.
            SpoolError: The spool cannot be read.
        """
        rejected = dict.fromkeys(
            nodes, "the gateway has no certificate of it; let the node connect"
        )
        chains = [(node, chain) for node in nodes if (chain := self._chain(node)) is not None]
        for begin in range(0, len(chains), _MAX_CHAINS):
            some = chains[begin : begin + _MAX_CHAINS]
            reasons = self._post([[chain.leaf, chain.issuer] for _, chain in some])
            for (node, _), reason in zip(some, reasons, strict=True):
                if reason is None:
                    del rejected[node]
                else:
                    rejected[node] = reason
        return rejected

    def _chain(self, node: str) -> NodeCertificate | None:
        state = self._spool.node(node)
        if state is None or state.thumbprint is None:
            return None
        return self._spool.certificate(state.thumbprint)

    def _post(self, chains: list[list[bytes]]) -> list[str | None]:
        body = self._client.post("certificates", cbor2.dumps(chains))
        with parsing(body):
            reasons = [item["reason"] for item in orjson.loads(body)["items"]]
        if len(reasons) != len(chains):
            raise CloudError(f"the cloud answered for {len(reasons)} of {len(chains)} chains")
        return [None if reason is None else str(reason)[:200] for reason in reasons]
