"""Fetching commands from the cloud over HTTPS: the gateway asks, the cloud lets it wait."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, Protocol

import cbor2
import httpx

from eskin.errors import MessageError
from eskin.identity import IdentityKind
from eskin.wire.messages.cbor_map import MOST_BYTES, MOST_COUNT, integer, items, load_any
from eskin_gateway.upstream.cloud_client import answering, as_agreed, require_ok, require_short

if TYPE_CHECKING:
    import ssl
    from collections.abc import Callable, Mapping, Sequence

    import httpcore


_MOST_HELD: Final = 10_000


@dataclass(frozen=True, slots=True)
class Changes:
    """What the cloud says.

    Attributes:
        give: ``(node, id, signed command)`` to deliver.
        drop: ``(node, id)`` to deliver no more.
    """

    give: list[tuple[str, int, bytes]]
    drop: list[tuple[str, int]]

    @classmethod
    def read(cls, body: bytes) -> Changes:
        """Read an answer.

        Raises:
            CloudError: It is not as agreed.
        """
        with as_agreed(body):
            said = load_any(body, "the answer")
            give = [_given(item) for item in _list(said, "give")]
            drop = [_place(item, 2) for item in _list(said, "drop")]
        return cls(give, drop)


class Deliveries(Protocol):
    """What the gateway needs of the cloud to learn of commands."""

    async def fetch(self, held: Sequence[tuple[str, int, bool]], wait_s: float) -> Changes:
        """Ask, and wait for a change.

        Args:
            held: ``(node, id, published)`` of the commands that the gateway has.
            wait_s: Seconds to wait at most.

        Raises:
            CloudError: The cloud did not answer as agreed.
        """

    async def close(self) -> None:
        """Close the connection."""


class HttpsDeliveries:
    """The cloud's deliveries over HTTPS.

    Args:
        url: The cloud's ingest; deliveries are beside it.
        headers: Gives those of a request.
        context: Leads to our root, and shows the gateway's certificate.
        timeout_s: Seconds to wait for an answer that is due.
    """

    def __init__(
        self,
        url: str,
        *,
        headers: Callable[[], dict[str, str]],
        context: ssl.SSLContext,
        timeout_s: float,
    ) -> None:
        self._url = httpx.URL(url).join("deliveries")
        self._headers = headers
        self._timeout = timeout_s
        # The environment's proxies are no part of the way from a gateway to its cloud. Between two
        # questions no connection is kept: it would hold up a cloud that ends.
        self._client = httpx.AsyncClient(
            verify=context, trust_env=False, limits=httpx.Limits(max_keepalive_connections=0)
        )
        self._stream: httpcore.AsyncNetworkStream | None = None

    async def fetch(self, held: Sequence[tuple[str, int, bool]], wait_s: float) -> Changes:
        """See `Deliveries.fetch`."""
        body = cbor2.dumps({"held": [list(one) for one in held[:_MOST_HELD]], "wait_s": wait_s})
        timeout = httpx.Timeout(self._timeout, read=self._timeout + wait_s)
        with answering(self._url):
            async with self._client.stream(
                "POST",
                self._url,
                content=body,
                headers=self._headers(),
                timeout=timeout,
                extensions={"trace": self._note},
            ) as answer:
                require_ok(answer)
                found = bytearray()
                async for part in answer.aiter_bytes():
                    found += part
                    require_short(found)
        return Changes.read(bytes(found))

    async def close(self) -> None:
        """See `Deliveries.close`."""
        # httpcore forgets the socket of a handshake that is cancelled.
        if self._stream is not None:
            await self._stream.aclose()
        await self._client.aclose()

    async def _note(self, event: str, info: Mapping[str, Any]) -> None:
        if event == "connection.connect_tcp.complete":
            self._stream = info["return_value"]


def _list(said: object, name: str) -> list[object]:
    if not isinstance(said, dict) or set(said) != {"give", "drop"}:
        raise MessageError("it is no map of give and drop")
    return items(said[name], name, _MOST_HELD)


def _given(item: object) -> tuple[str, int, bytes]:
    node, number = _place(item, 3)
    signed = items(item, "entry", 3)[2]
    if not isinstance(signed, bytes) or len(signed) > MOST_BYTES:
        raise MessageError(f"the command of {node} is no byte string of at most {MOST_BYTES}")
    return node, number, signed


def _place(item: object, parts: int) -> tuple[str, int]:
    found = items(item, "entry", parts)
    if len(found) != parts or not isinstance(found[0], str):
        raise MessageError("an entry does not begin with a node's name and an id")
    return IdentityKind.NODE.require_name(found[0]), integer(found[1], "id", 1, MOST_COUNT)
