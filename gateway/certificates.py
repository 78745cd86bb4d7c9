"""Presenting nodes' certificates to the cloud, which takes nothing of a node before."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, Protocol

import cbor2
import httpx
import orjson

from eskin.errors import CloudError
from gateway.refusal import require_ok

if TYPE_CHECKING:
    import ssl
    from collections.abc import Callable, Collection

    from gateway.batch import Sender
    from gateway.spool import Spool

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
        url: The cloud's ingest; certificates are beside it.
        spool: Remembers the chain that each node used last.
        headers: Gives those of a request.
        context: Leads to our root, and shows the gateway's certificate.
        timeout_s: Seconds to wait.
    """

    def __init__(
        self,
        url: str,
        *,
        spool: Spool,
        headers: Callable[[], dict[str, str]],
        context: ssl.SSLContext,
        timeout_s: float,
    ) -> None:
        self._url = httpx.URL(url).join("certificates")
        self._spool = spool
        self._headers = headers
        self._client = httpx.Client(verify=context, timeout=timeout_s, trust_env=False)

    def close(self) -> None:
        """Close the connection."""
        self._client.close()

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
        try:
            body = cbor2.dumps(chains)
            answer = self._client.post(self._url, content=body, headers=self._headers())
            require_ok(answer)
            reasons = [item["reason"] for item in orjson.loads(answer.content)["items"]]
        except httpx.HTTPError as error:
            raise CloudError(f"{self._url}: {type(error).__name__}: {error}") from error
        except (orjson.JSONDecodeError, KeyError, TypeError) as error:
            raise CloudError(f"{self._url}: the answer is not as agreed") from error
        if len(reasons) != len(chains):
            raise CloudError(f"{self._url} answered for {len(reasons)} of {len(chains)} chains")
        return [None if reason is None else str(reason)[:200] for reason in reasons]
