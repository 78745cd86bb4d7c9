"""Sends subjects' keys and erasures to the cloud."""

from __future__ import annotations

from typing import TYPE_CHECKING

import cbor2
import orjson

from eskin_gateway.upstream.cloud_client import parsing

if TYPE_CHECKING:
    from collections.abc import Sequence

    from eskin_gateway.upstream.cloud_client import CloudClient


class SubjectsClient:
    """The cloud's ``subjects``.

    Args:
        client: Posts to the cloud.
    """

    def __init__(self, client: CloudClient) -> None:
        self._client = client

    def send(
        self, assigned: Sequence[tuple[str, str, bytes | None]], erased: Sequence[str]
    ) -> dict[str, str]:
        """Send subjects and return the result for each.

        A result is ``kept``, ``declined`` or ``erased``; ``conflict`` if the cloud keeps another
        key; ``unknown_node`` if the cloud has no certificate of the node.

        Args:
            assigned: Pseudonym, node, and the key if the cloud may have it.
            erased: Pseudonyms whose keys the cloud must destroy.

        Raises:
            CloudError: The request failed.
        """
        body = cbor2.dumps({"worn": [list(item) for item in assigned], "erased": list(erased)})
        response = self._client.post("subjects", body)
        with parsing(response):
            items = orjson.loads(response)["items"]
            results: dict[str, str] = {item["id"]: item["result"] for item in items}
            # Of a subject with several nodes, a failure is the result.
            failed = [item for item in items if item["result"] in {"conflict", "unknown_node"}]
            return results | {item["id"]: item["result"] for item in failed}
