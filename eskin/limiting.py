"""How often one address may do something: in memory, by sliding windows."""

from __future__ import annotations

from ipaddress import IPv6Address, ip_address
from typing import Final

from limits import RateLimitItemPerSecond
from limits.aio.storage import MemoryStorage
from limits.aio.strategies import SlidingWindowCounterRateLimiter

_NETWORK_BITS: Final = 64


class Rate:
    """So many in so many seconds, for each address.

    Args:
        most: How many.
        seconds: In which time.
    """

    def __init__(self, most: int, seconds: int) -> None:
        self._item = RateLimitItemPerSecond(most, seconds)
        self._windows = SlidingWindowCounterRateLimiter(MemoryStorage())

    async def take(self, address: str) -> bool:
        """Count one; gives whether it is one of those that are allowed."""
        return await self._windows.hit(self._item, source_of(address))


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
