"""Limits on how many requests one address makes; of bytes and time `eskin.listening` takes care."""

from __future__ import annotations

from http import HTTPStatus
from typing import TYPE_CHECKING

from starlette.requests import Request

from cloud.dependencies import address_of
from cloud.problems import log_refusal, problem
from eskin.limiting import counted

if TYPE_CHECKING:
    from starlette.responses import Response
    from starlette.types import ASGIApp, Receive, Scope, Send

    from cloud.rate_limits import RateLimits
    from eskin.limiting import RateLimit


class LimitsMiddleware:
    """Refuses floods (429) before anything else is done.

    Good credentials are not kept out by bad ones from the same address: only answers that are
    refusals already count as failures, and turn into 429 where there are too many.

    Args:
        app: The application inside.
        rate_limits: Counts.
        refusal: Status of answers to those without good credentials.
    """

    def __init__(
        self,
        app: ASGIApp,
        *,
        rate_limits: RateLimits,
        refusal: HTTPStatus = HTTPStatus.UNAUTHORIZED,
    ) -> None:
        self._refusal = refusal
        self._app = app
        self._rate_limits = rate_limits

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on, or refuse it."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        request = Request(scope)
        requests = self._rate_limits.requests
        if not await requests.take(address_of(request)):
            await _flood(request, "requests", requests)(scope, receive, send)
            return
        await self._app(scope, receive, self._counting(request, receive, send))

    def _counting(self, request: Request, receive: Receive, send: Send) -> Send:
        """Send, but count what is refused for want of credentials."""
        rate, what = self._rate_limits.failures, "requests without good credentials"
        return counted(
            send,
            rate=rate,
            address=address_of(request),
            statuses={self._refusal},
            flooded=lambda: _flood(request, what, rate)(request.scope, receive, send),
            admitted=lambda: log_refusal(request),
        )


def _flood(request: Request, what: str, rate: RateLimit) -> Response:
    told = f"too many {what} from your address; wait a little"
    return problem(request, 429, told, headers=rate.pause)
