"""How often one address may do something: in memory, by sliding windows.

Requests a second are counted over ten seconds, as a page asks for much at once; what is refused,
over a minute. A rejected client gets that time in Retry-After.
"""

from __future__ import annotations

from http import HTTPStatus
from ipaddress import IPv6Address, ip_address
from typing import TYPE_CHECKING, Final, Self

from limits import RateLimitItemPerSecond
from limits.aio.storage import MemoryStorage
from limits.aio.strategies import SlidingWindowCounterRateLimiter

from eskin.runtime.http_server.problems import log_refusal, problem

if TYPE_CHECKING:
    from collections.abc import Container

    from starlette.responses import Response
    from starlette.types import ASGIApp, Message, Receive, Scope, Send

_SPAN_S: Final = 10
_MINUTE_S: Final = 60
_NETWORK_BITS: Final = 64


class RateLimit:
    """So many in so many seconds, for each address.

    Args:
        most: How many.
        seconds: In which time.

    Attributes:
        pause: Header of the answer to a client that has no more of them.
    """

    def __init__(self, most: int, seconds: int) -> None:
        self._item = RateLimitItemPerSecond(most, seconds)
        self._windows = SlidingWindowCounterRateLimiter(MemoryStorage())
        self.pause = {"Retry-After": str(seconds)}

    @classmethod
    def per_second(cls, most: int) -> Self:
        """So many a second, over ten seconds."""
        return cls(most * _SPAN_S, _SPAN_S)

    @classmethod
    def per_minute(cls, most: int) -> Self:
        """So many a minute."""
        return cls(most, _MINUTE_S)

    async def take(self, address: str) -> bool:
        """Count one; gives whether it is one of those that are allowed."""
        return await self._windows.hit(self._item, source_of(address))


class LimitsMiddleware:
    """Answers floods with 429 before anything else is done.

    Good requests are not kept out by bad ones from the same address: only answers that are refusals
    already count as such, and turn into 429 where there are too many.

    Args:
        app: The application inside.
        requests: Counts all requests.
        refused: Counts refusals.
        statuses: Which answers are refusals.
    """

    def __init__(
        self,
        app: ASGIApp,
        *,
        requests: RateLimit,
        refused: RateLimit,
        statuses: Container[int],
    ) -> None:
        self._app = app
        self._requests = requests
        self._refused = refused
        self._statuses = statuses

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on, or refuse it."""
        if scope["type"] not in {"http", "websocket"}:
            await self._app(scope, receive, send)
            return
        address = (scope.get("client") or ("",))[0]
        if not await self._requests.take(address):
            await _flood(scope, "requests", self._requests)(scope, receive, send)
            return
        replaced = False

        async def sending(message: Message) -> None:
            nonlocal replaced
            if message.get("status") in self._statuses:
                replaced = not await self._refused.take(address)
                if replaced:
                    answer = _flood(scope, "requests that were refused", self._refused)
                    await answer(scope, receive, send)
                else:
                    log_refusal(scope)
            if not replaced:
                await send(message)

        await self._app(scope, receive, sending)


def _flood(scope: Scope, what: str, rate: RateLimit) -> Response:
    detail = f"too many {what} from your address; wait a little"
    return problem(scope, HTTPStatus.TOO_MANY_REQUESTS, detail, headers=rate.pause)


def source_of(address: str) -> str:
    """The unit of a limit: an IPv4 address, or the /64 network that an IPv6 user has at least."""
    try:
        found = ip_address(address.partition("%")[0])
    except ValueError:
        return address
    if not isinstance(found, IPv6Address):
        return str(found)
    if found.ipv4_mapped is not None:
        return str(found.ipv4_mapped)
    return str(IPv6Address(int(found) >> _NETWORK_BITS << _NETWORK_BITS))
