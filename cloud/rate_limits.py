"""How often one address may ask."""

from __future__ import annotations

from typing import TYPE_CHECKING

from eskin.limiting import RateLimit

if TYPE_CHECKING:
    from cloud.settings import LimitsSection


class RateLimits:
    """Counts what each address asks.

    Args:
        settings: How many are allowed.

    Attributes:
        requests: All of them.
        failures: Requests without good credentials.
        refusals: Refused sign-ins that are kept.
    """

    def __init__(self, settings: LimitsSection) -> None:
        self.requests = RateLimit.per_second(settings.requests_per_s)
        self.failures = RateLimit.per_minute(settings.failures_per_min)
        self.refusals = RateLimit.per_minute(settings.refusals_per_min)
