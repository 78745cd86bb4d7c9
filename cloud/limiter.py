"""How often one address may ask."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from eskin.limiting import Rate

if TYPE_CHECKING:
    from cloud.settings import LimitsSection

_SPAN_S: Final = 10
_MINUTE_S: Final = 60


class Limiter:
    """Counts requests, and those without good credentials.

    Args:
        settings: How many are allowed.
    """

    def __init__(self, settings: LimitsSection) -> None:
        self._requests = Rate(settings.requests_per_s * _SPAN_S, _SPAN_S)
        self._failures = Rate(settings.failures_per_min, _MINUTE_S)
        self._refusals = Rate(settings.refusals_per_min, _MINUTE_S)

    async def take_request(self, address: str) -> bool:
        """Count a request; gives whether it is allowed."""
        return await self._requests.take(address)

    async def take_failure(self, address: str) -> bool:
        """Count a request without good credentials; gives whether it is one of the allowed."""
        return await self._failures.take(address)

    async def take_refusal(self, address: str) -> bool:
        """Count a refused sign-in; gives whether it is one of those that are kept."""
        return await self._refusals.take(address)
