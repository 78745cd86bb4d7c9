"""Asks the cloud which confirmed messages its store no longer has."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING, Final

import cbor2
import orjson

from eskin_gateway.upstream.cloud_client import parsing

if TYPE_CHECKING:
    from collections.abc import Sequence

    from eskin_gateway.upstream.certificates_client import CertificatesClient
    from eskin_gateway.upstream.cloud_client import CloudClient

log = logging.getLogger(__name__)

_MAX_BOOTS: Final = 5000


class ConfirmationsClient:
    """The cloud's ``confirmed``: detects that its store was restored from an older copy.

    Args:
        client: Posts to the cloud.
        certificates_client: Registers the nodes that a restored store does not know.
    """

    def __init__(self, client: CloudClient, certificates_client: CertificatesClient) -> None:
        self._client = client
        self._certificates_client = certificates_client

    def find_missing(
        self, confirmed: Sequence[tuple[str, int, int]]
    ) -> list[tuple[str, int, int, int]]:
        """Find confirmed messages that the cloud no longer has.

        Args:
            confirmed: Node, boot, and the last sequence of it that the cloud confirmed.

        Returns:
            Node, boot, first and last sequence of what is missing.

        Raises:
            CloudError: The request failed.
            SpoolError: The spool cannot be read.
        """
        missing, unknown = self._post(confirmed)
        if not unknown:
            return missing
        for node, reason in self._certificates_client.register(unknown).items():
            log.warning("cloud rejects a certificate: node=%s reason=%s", node, reason)
        more, unknown = self._post([item for item in confirmed if item[0] in unknown])
        # The cloud stores nothing of an unknown node, so everything of these is missing.
        everything = [(node, boot, 0, last) for node, boot, last in confirmed if node in unknown]
        return missing + more + everything

    def _post(
        self, confirmed: Sequence[tuple[str, int, int]]
    ) -> tuple[list[tuple[str, int, int, int]], set[str]]:
        """Return what is missing, and nodes that the cloud does not know."""
        missing, unknown = [], set[str]()
        for begin in range(0, len(confirmed), _MAX_BOOTS):
            some = [list(item) for item in confirmed[begin : begin + _MAX_BOOTS]]
            body = self._client.post("confirmed", cbor2.dumps(some))
            with parsing(body):
                response = orjson.loads(body)
                missing += [
                    (str(r["node"]), int(r["boot"]), int(r["first"]), int(r["last"]))
                    for r in response["items"]
                ]
                unknown.update(str(node) for node in response["unknown_nodes"])
        return missing, unknown
