"""Limits on every request: how many there are, how long a body is, and how slowly it may come."""

from __future__ import annotations

import asyncio
from http import HTTPStatus
from typing import TYPE_CHECKING, Final

from starlette.requests import Request

from cloud.dependencies import address_of
from cloud.problems import ProblemError, log_refusal, problem
from eskin.limiting import counted

if TYPE_CHECKING:
    from starlette.responses import Response
    from starlette.types import ASGIApp, Message, Receive, Scope, Send

    from cloud.rate_limits import RateLimits
    from eskin.limiting import RateLimit

_PATIENCE_S: Final = 20.0


class LimitsMiddleware:
    """Refuses floods (429), long bodies (413) and slow ones (408) before anything else is done.

    Good credentials are not kept out by bad ones from the same address: only answers that are
    refusals already count as failures, and turn into 429 where there are too many.

    Args:
        app: The application inside.
        rate_limits: Counts.
        body: Bytes that a body may have; ``None`` where routes look after that themselves.
        refusal: Status of answers to those without good credentials.
    """

    def __init__(
        self,
        app: ASGIApp,
        *,
        rate_limits: RateLimits,
        body: int | None,
        refusal: HTTPStatus = HTTPStatus.UNAUTHORIZED,
    ) -> None:
        self._refusal = refusal
        self._app = app
        self._rate_limits = rate_limits
        self._body = body

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
        if self._body is not None:
            try:
                receive = _first(await _read_body(receive, self._body), receive)
            except ProblemError as refusal:
                await problem(request, refusal.status, str(refusal))(scope, receive, send)
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


def _first(message: Message, receive: Receive) -> Receive:
    """Receive a message that was received already, then go on."""
    waiting = [message]

    async def receiving() -> Message:
        return waiting.pop() if waiting else await receive()

    return receiving


async def _read_body(receive: Receive, most: int) -> Message:
    """The whole body as one message.

    Raises:
        ProblemError: It is too long, or too slow.
    """
    body = bytearray()
    try:
        async with asyncio.timeout(_PATIENCE_S):
            while True:
                message = await receive()
                body += message.get("body", b"")
                if len(body) > most:
                    raise ProblemError(413, f"the body is longer than {most} bytes; send less")
                if message["type"] != "http.request":
                    return message
                if not message.get("more_body", False):
                    return {"type": "http.request", "body": bytes(body), "more_body": False}
    except TimeoutError:
        raise ProblemError(408, f"the body did not come within {_PATIENCE_S:g} s") from None
