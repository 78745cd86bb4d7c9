"""Sends batches of messages to the cloud."""

from __future__ import annotations

from functools import lru_cache
from operator import attrgetter
from typing import TYPE_CHECKING, Any, Final, Literal, NamedTuple

import orjson

from eskin.errors import CloudError
from eskin.wire.messages.cbor_map import ARRAY, BYTES, TEXT, opening
from eskin.wire.slot import even_groups, share_out, slot_of
from eskin_gateway.upstream.cloud_client import parsing

if TYPE_CHECKING:
    from collections.abc import Sequence

    from eskin_gateway.spool.batch import SpoolMessage
    from eskin_gateway.upstream.cloud_client import CloudClient


class ItemResult(NamedTuple):
    """What the cloud did with one message. A tuple, because there are many.

    Attributes:
        result: ``stored`` and ``duplicate`` mean that the message is durable in the cloud.
            ``unknown_node`` means that the node's certificate must be registered first,
            ``unknown_layout`` that descriptions must be posted first, ``later`` that the cloud
            cannot store the message now, but stores others of the batch.
        reason: Why the message was not stored.
        want: Hashes of those descriptions.
    """

    result: Literal["stored", "duplicate", "rejected", "unknown_node", "unknown_layout", "later"]
    reason: str | None
    want: tuple[bytes, ...] = ()

    @property
    def is_later(self) -> bool:
        """Whether the message must be sent again."""
        return self.result == "later"


_RESULTS: Final = {"stored", "duplicate", "rejected", "unknown_node", "unknown_layout", "later"}
_STORED_ITEM: Final = {"result": "stored", "reason": None}
_STORED: Final = ItemResult("stored", None)


class IngestClient:
    """The cloud's ``ingest``.

    Args:
        client: Posts to the cloud.
    """

    def __init__(self, client: CloudClient) -> None:
        self._client = client

    @property
    def url(self) -> str:
        """The ingest of the cloud that is tried first."""
        return self._client.url

    def shares(self, messages: Sequence[SpoolMessage]) -> list[list[SpoolMessage]]:
        """Messages by the cloud that has the slot of their node, each for a request of its own."""
        groups = even_groups(self._client.clouds)
        return [each.items for each in share_out(messages, attrgetter("node"), groups)]

    def send(self, messages: Sequence[tuple[str, bytes]]) -> list[ItemResult]:
        """Send messages (node, plaintext) of one share; return a result for each, in order.

        Raises:
            CloudError: The request failed. The messages may be stored or not.
        """
        slot = slot_of(messages[0][0])
        body = self._client.post("ingest", encode_batch(messages), slot=slot)
        with parsing(body):
            results = [_item_result(item) for item in orjson.loads(body)["items"]]
        if len(results) != len(messages):
            raise CloudError(f"the cloud answered for {len(results)} of {len(messages)} messages")
        return results


def encode_batch(messages: Sequence[tuple[str, bytes]]) -> bytes:
    """CBOR array of ``[node, plaintext]``, joined from encoded parts."""
    parts = [opening(ARRAY, len(messages))]
    for node, body in messages:
        parts += _encode_node(node), opening(BYTES, len(body)), body
    return b"".join(parts)


@lru_cache(4096)
def _encode_node(node: str) -> bytes:
    """Head of a pair, and its node."""
    name = node.encode()
    return opening(ARRAY, 2) + opening(TEXT, len(name)) + name


def _item_result(item: dict[str, Any]) -> ItemResult:
    if item == _STORED_ITEM:
        return _STORED
    result, reason = item["result"], item.get("reason")
    want = tuple(bytes.fromhex(name) for name in item.get("want") or ())
    if (
        result not in _RESULTS
        or not isinstance(reason, str | None)
        or (result == "unknown_layout") is not bool(want)
    ):
        raise TypeError(f"no result: {item!r}")
    return ItemResult(result, reason, want)
