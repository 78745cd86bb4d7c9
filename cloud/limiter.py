"""How often one address may ask; in memory, by sliding windows."""

from __future__ import annotations

from ipaddress import IPv6Address, ip_address
from typing import TYPE_CHECKING, Final

from limits import RateLimitItemPerMinute, RateLimitItemPerSecond
from limits.aio.storage import MemoryStorage
from limits.aio.strategies import SlidingWindowCounterRateLimiter

if TYPE_CHECKING:
    from cloud.settings import LimitsSection

_SPAN_S: Final = 10
_NETWORK_BITS: Final = 64


class Limiter:
    """Counts requests, and those without good credentials.

    Args:
        settings: How many are allowed.
    """

    def __init__(self, settings: LimitsSection) -> None:
        self._requests = RateLimitItemPerSecond(settings.requests_per_s * _SPAN_S, _SPAN_S)
        self._failures = RateLimitItemPerMinute(settings.failures_per_min)
        self._refusals = RateLimitItemPerMinute(settings.refusals_per_min)
        self._windows = SlidingWindowCounterRateLimiter(MemoryStorage())

    async def take_request(self, address: str) -> bool:
        """Count a request; gives whether it is allowed."""
        return await self._windows.hit(self._requests, "request", source_of(address))

    async def take_failure(self, address: str) -> bool:
        """Count a request without good credentials; gives whether it is one of the allowed."""
        return await self._windows.hit(self._failures, "failure", source_of(address))

    async def take_refusal(self, address: str) -> bool:
        """Count a refused sign-in; gives whether it is one of those that are kept."""
        return await self._windows.hit(self._refusals, "refusal", source_of(address))


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
