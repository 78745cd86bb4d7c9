"""Sends batches of messages to the cloud."""

from __future__ import annotations

import math
import time
from functools import lru_cache
from typing import TYPE_CHECKING, Any, Final, Literal, NamedTuple

import orjson

from eskin.errors import CloudError
from eskin.wire.messages.acknowledgement import MOST_WATCHED
from eskin.wire.messages.cbor_map import ARRAY, BYTES, TEXT, opening
from eskin_gateway.upstream.cloud_client import parsing

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from eskin_gateway.upstream.cloud_client import CloudClient

_MAX_VIEWED_NODES: Final = 4096
"""Bounds the memory that the cloud's responses take."""


class ItemResult(NamedTuple):
    """What the cloud did with one message. A tuple, because there are many.

    Attributes:
        result: ``stored`` and ``duplicate`` mean that the message is durable in the cloud.
            ``unknown_node`` means that the node's certificate must be registered first,
            ``unknown_layout`` that descriptions must be posted first.
        reason: Why the message was rejected.
        want: Hashes of those descriptions.
    """

    result: Literal["stored", "duplicate", "rejected", "unknown_node", "unknown_layout"]
    reason: str | None
    want: tuple[bytes, ...] = ()


_RESULTS: Final = {"stored", "duplicate", "rejected", "unknown_node", "unknown_layout"}
_STORED_ITEM: Final = {"result": "stored", "reason": None}
_STORED: Final = ItemResult("stored", None)


class IngestClient:
    """The cloud's ``ingest``.

    Args:
        client: Posts to the cloud.
        viewers: Updated with the nodes that are viewed.
    """

    def __init__(self, client: CloudClient, viewers: Viewers) -> None:
        self._client = client
        self._viewers = viewers

    def send(self, messages: Sequence[tuple[str, bytes]]) -> list[ItemResult]:
        """Send messages (node, plaintext) and return a result for each, in order.

        Raises:
            CloudError: The request failed. The messages may be stored or not.
        """
        body = self._client.post("ingest", encode_batch(messages))
        with parsing(body):
            response = orjson.loads(body)
            results = [_item_result(item) for item in response["items"]]
            watched = {n: _seconds(span) for n, span in response.get("watched", {}).items()}
        if len(results) != len(messages):
            raise CloudError(f"the cloud answered for {len(results)} of {len(messages)} messages")
        self._viewers.update(watched)
        return results


class Viewers:
    """How long each node is viewed. One thread updates, another one reads.

    Args:
        clock: Monotonic seconds.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._until: dict[str, float] = {}

    def update(self, watched: Mapping[str, float]) -> None:
        """Add nodes, with the seconds for which each is viewed."""
        if not watched and not self._until:
            return
        now = self._clock()
        until = {node: until for node, until in self._until.items() if until > now}
        until |= {node: now + seconds for node, seconds in watched.items()}
        self._until = dict(list(until.items())[-_MAX_VIEWED_NODES:])

    def remaining(self, node: str) -> int:
        """Milliseconds for which a node is viewed, or 0."""
        until = self._until.get(node)
        if until is None:
            return 0
        return max(0, min(MOST_WATCHED, round((until - self._clock()) * 1000)))


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


def _seconds(span: Any) -> float:
    seconds = float(span)
    if not math.isfinite(seconds):
        raise ValueError(f"no duration: {seconds}")
    return seconds


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
