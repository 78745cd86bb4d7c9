"""Telling the cloud of subjects over HTTPS."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

import cbor2
import orjson

from eskin_gateway.upstream.cloud_client import as_agreed

if TYPE_CHECKING:
    from collections.abc import Sequence

    from eskin_gateway.upstream.cloud_client import CloudClient


class Notices(Protocol):
    """What the gateway needs of the cloud to have keys kept and destroyed."""

    def send(
        self, worn: Sequence[tuple[str, str, bytes | None]], erased: Sequence[str]
    ) -> dict[str, str]:
        """Tell, and learn what became of each subject's key.

        It is kept, declined or erased; in ``conflict`` with another one that is kept; or not taken,
        as the cloud has no certificate of the node (``unknown_node``).

        Args:
            worn: Pseudonym, node, and the key if the cloud may have it.
            erased: Pseudonyms whose keys are to be destroyed.

        Raises:
            CloudError: The cloud did not answer as agreed.
        """


class HttpsNotices:
    """The cloud's subjects over HTTPS.

    Args:
        client: The way to the cloud.
    """

    def __init__(self, client: CloudClient) -> None:
        self._client = client

    def send(
        self, worn: Sequence[tuple[str, str, bytes | None]], erased: Sequence[str]
    ) -> dict[str, str]:
        """See `Notices.send`."""
        body = cbor2.dumps({"worn": [list(one) for one in worn], "erased": list(erased)})
        answer = self._client.post("subjects", body)
        with as_agreed(answer):
            items = orjson.loads(answer)["items"]
            # Of a subject at several nodes, what keeps one of them from being told is told.
            found: dict[str, str] = {item["id"]: item["result"] for item in items}
            hindered = [item for item in items if item["result"] in {"conflict", "unknown_node"}]
            return found | {item["id"]: item["result"] for item in hindered}
