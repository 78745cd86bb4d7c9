"""Posts descriptions to the cloud, which stores no frame whose layout it lacks."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, Literal, NamedTuple

import orjson

from eskin.errors import CloudError
from eskin_gateway.upstream.cloud_client import parsing
from eskin_gateway.upstream.ingest_client import encode_batch

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from eskin_gateway.spool.spool import Spool
    from eskin_gateway.upstream.cloud_client import CloudClient

_MAX_ITEMS: Final = 64
"""In one request: 4 MiB of the longest."""
_RESULTS: Final = {"stored", "duplicate", "rejected", "unknown_node"}


class Posted(NamedTuple):
    """What the cloud did with a description.

    Attributes:
        result: ``rejected`` if the cloud takes no message that needs it.
        reason: Why it was rejected.
    """

    result: Literal["stored", "duplicate", "rejected", "unknown_node"]
    reason: str | None


class DescriptionsClient:
    """The cloud's ``descriptions``.

    Args:
        client: Posts to the cloud.
        spool: Holds the descriptions.
    """

    def __init__(self, client: CloudClient, spool: Spool) -> None:
        self._client = client
        self._spool = spool

    def post(self, wanted: Sequence[tuple[str, bytes]]) -> dict[tuple[str, bytes], Posted]:
        """Post descriptions, each named by its node and hash, and return what became of each.

        Raises:
            CloudError: The request failed.
            SpoolError: The spool cannot be read.
        """
        lost = Posted("rejected", "the gateway's spool lost it: check the disk")
        posted = dict.fromkeys(wanted, lost)
        for begin in range(0, len(wanted), _MAX_ITEMS):
            read = (
                (key, self._spool.description(*key)) for key in wanted[begin : begin + _MAX_ITEMS]
            )
            found = {key: body for key, body in read if body is not None}
            if found:
                posted.update(zip(found, self._post(found), strict=True))
        return posted

    def _post(self, found: Mapping[tuple[str, bytes], bytes]) -> list[Posted]:
        items = [(node, description) for (node, _), description in found.items()]
        body = self._client.post("descriptions", encode_batch(items))
        with parsing(body):
            answered = [
                Posted(item["result"], item.get("reason")) for item in orjson.loads(body)["items"]
            ]
            if not _RESULTS.issuperset(each.result for each in answered):
                raise ValueError("a result is unknown")
        if len(answered) != len(items):
            raise CloudError(f"the cloud answered for {len(answered)} of {len(items)} descriptions")
        return answered
