"""The seam to the cloud, and the cloud over HTTPS."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import TYPE_CHECKING, Any, Final, Literal, NamedTuple, Protocol

import orjson

from eskin.errors import CloudError
from eskin.wire.messages.cbor_head import ARRAY, BYTES, TEXT, opening
from eskin_gateway.upstream.cloud_client import as_agreed

if TYPE_CHECKING:
    from collections.abc import Sequence

    from eskin_gateway.upstream.cloud_client import CloudClient
    from eskin_gateway.upstream.viewers import Viewers


class Answer(NamedTuple):
    """What the cloud did with one message; a tuple, because there are many.

    Attributes:
        result: Both ``stored`` and ``duplicate`` mean that it is durable there; ``unknown_node``,
            that nothing is kept of it before the node's certificate is presented.
        reason: Why it was rejected.
    """

    result: Literal["stored", "duplicate", "rejected", "unknown_node"]
    reason: str | None


_RESULTS: Final = {"stored", "duplicate", "rejected", "unknown_node"}
_STORED: Final = {"result": "stored", "reason": None}
_KEPT: Final = Answer("stored", None)


class Cloud(Protocol):
    """What the gateway needs of the cloud."""

    def send(self, messages: Sequence[tuple[str, bytes]]) -> list[Answer]:
        """Send messages (node, plaintext) in order.

        Returns:
            One answer for each message, in the same order.

        Raises:
            CloudError: The cloud did not answer as agreed; nothing is known of any message.
        """


class HttpsCloud:
    """The cloud's ingest over HTTPS.

    Args:
        client: The way to the cloud.
        viewers: Hear which nodes people look at.
    """

    def __init__(self, client: CloudClient, viewers: Viewers) -> None:
        self._client = client
        self._viewers = viewers

    def send(self, messages: Sequence[tuple[str, bytes]]) -> list[Answer]:
        """See `Cloud.send`."""
        body = self._client.post("ingest", as_batch(messages))
        answers, watched = _answers(body, len(messages))
        self._viewers.note(watched)
        return answers


def as_batch(messages: Sequence[tuple[str, bytes]]) -> bytes:
    """CBOR array of ``[node, plaintext]``: what is encoded already is only put together."""
    parts = [opening(ARRAY, len(messages))]
    for node, body in messages:
        parts += _addressed(node), opening(BYTES, len(body)), body
    return b"".join(parts)


@lru_cache(4096)
def _addressed(node: str) -> bytes:
    """The beginning of a pair, and its node."""
    name = node.encode()
    return opening(ARRAY, 2) + opening(TEXT, len(name)) + name


def _answers(body: bytes, expected: int) -> tuple[list[Answer], dict[str, float]]:
    """What became of the messages; and nodes that are watched, and for how many seconds."""
    with as_agreed(body):
        said = orjson.loads(body)
        answers = [_answer(item) for item in said["items"]]
        watched = {str(node): _seconds(span) for node, span in said.get("watched", {}).items()}
    if len(answers) != expected:
        raise CloudError(f"the cloud answered for {len(answers)} of {expected} messages")
    return answers, watched


def _seconds(span: Any) -> float:
    seconds = float(span)
    if not math.isfinite(seconds):
        raise ValueError(f"no span of time: {seconds}")
    return seconds


def _answer(item: dict[str, Any]) -> Answer:
    if item == _STORED:
        return _KEPT
    result, reason = item["result"], item.get("reason")
    if result not in _RESULTS or not isinstance(reason, str | None):
        raise TypeError(f"no result: {item!r}")
    return Answer(result, reason)
