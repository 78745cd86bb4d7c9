"""How often one address may do something: in memory, by sliding windows.

Requests a second are counted over ten seconds, as a page asks for much at once; what is refused,
over a minute. Whoever is told to come again is told to wait for as long.
"""

from __future__ import annotations

from ipaddress import IPv6Address, ip_address
from typing import TYPE_CHECKING, Final, Self

from limits import RateLimitItemPerSecond
from limits.aio.storage import MemoryStorage
from limits.aio.strategies import SlidingWindowCounterRateLimiter

if TYPE_CHECKING:
    from collections.abc import Awaitable, Callable, Container

    from starlette.types import Message, Send

_SPAN_S: Final = 10
_MINUTE_S: Final = 60
_NETWORK_BITS: Final = 64


class RateLimit:
    """So many in so many seconds, for each address.

    Args:
        most: How many.
        seconds: In which time.

    Attributes:
        pause: Header of the answer to whoever has no more of them.
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


def counted(
    send: Send,
    *,
    rate: RateLimit,
    address: str,
    statuses: Container[int],
    flooded: Callable[[], Awaitable[None]],
    admitted: Callable[[], None],
) -> Send:
    """Send an answer on, but count it if it is a refusal.

    So good requests are not kept out by bad ones from the same address.

    Args:
        send: The way out.
        rate: Counts.
        address: Who asks.
        statuses: Which answers are refusals.
        flooded: Answers in their place where there are too many.
        admitted: Called before a refusal that is not one too many, such as to log it.
    """
    replaced = False

    async def sending(message: Message) -> None:
        nonlocal replaced
        if message.get("status") in statuses:
            replaced = not await rate.take(address)
            if replaced:
                await flooded()
            else:
                admitted()
        if not replaced:
            await send(message)

    return sending


def source_of(address: str) -> str:
    """Whom to count: an IPv4 address, or the network of 64 bit that one IPv6 user has at least."""
    try:
        found = ip_address(address.partition("%")[0])
    except ValueError:
        return address
    if not isinstance(found, IPv6Address):
        return str(found)
    if found.ipv4_mapped is not None:
        return str(found.ipv4_mapped)
    return str(IPv6Address(int(found) >> _NETWORK_BITS << _NETWORK_BITS))
