"""Asking the cloud over HTTPS whether it still has what it confirmed."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING, Any, Final, Protocol

import cbor2
import orjson

from eskin_gateway.upstream.cloud_client import as_agreed

if TYPE_CHECKING:
    from collections.abc import Sequence

    from eskin_gateway.upstream.certificates_client import Certificates
    from eskin_gateway.upstream.cloud_client import CloudClient

log = logging.getLogger(__name__)

_AT_ONCE: Final = 5000


class Confirmations(Protocol):
    """What the gateway needs of the cloud to notice that its store is an older copy."""

    def compare(self, confirmed: Sequence[tuple[str, int, int]]) -> list[tuple[str, int, int, int]]:
        """State where each boot ended; learn what is missing of it.

        Args:
            confirmed: Node, boot, and the greatest number of it that the cloud confirmed.

        Returns:
            Node, boot, first and last number of what the cloud does not have.

        Raises:
            CloudError: The cloud did not answer as agreed.
            SpoolError: The spool cannot be read.
        """


class HttpsConfirmations:
    """The cloud's ``confirmed`` over HTTPS.

    Args:
        client: The way to the cloud.
        certificates: Has the cloud know the nodes that a restored store does not know.
    """

    def __init__(self, client: CloudClient, certificates: Certificates) -> None:
        self._client = client
        self._certificates = certificates

    def compare(self, confirmed: Sequence[tuple[str, int, int]]) -> list[tuple[str, int, int, int]]:
        """See `Confirmations.compare`."""
        missing, unknown = self._ask(confirmed)
        if not unknown:
            return missing
        for node, reason in self._certificates.present(unknown).items():
            log.warning("cloud refuses a node's certificate: node=%s reason=%s", node, reason)
        found, unknown = self._ask([each for each in confirmed if each[0] in unknown])
        # The cloud stores nothing of a node before it knows it, so it has nothing of these either.
        nothing = [(node, boot, 0, last) for node, boot, last in confirmed if node in unknown]
        return missing + found + nothing

    def _ask(
        self, confirmed: Sequence[tuple[str, int, int]]
    ) -> tuple[list[tuple[str, int, int, int]], set[str]]:
        """What is missing, and nodes that the cloud does not know."""
        missing, unknown = [], set[str]()
        for begin in range(0, len(confirmed), _AT_ONCE):
            body = cbor2.dumps([list(each) for each in confirmed[begin : begin + _AT_ONCE]])
            answer = self._client.post("confirmed", body)
            with as_agreed(answer):
                said = orjson.loads(answer)
                missing += [_range(item) for item in said["items"]]
                unknown.update(str(node) for node in said["unknown_nodes"])
        return missing, unknown


def _range(item: dict[str, Any]) -> tuple[str, int, int, int]:
    return str(item["node"]), int(item["boot"]), int(item["first"]), int(item["last"])
