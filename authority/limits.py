"""How often one address may ask the CA service."""

from __future__ import annotations

from http import HTTPStatus
from typing import TYPE_CHECKING, Final

from authority.problems import log_refusal, problem
from eskin.limiting import RateLimit, counted

if TYPE_CHECKING:
    from fastapi.responses import JSONResponse
    from starlette.types import ASGIApp, Receive, Scope, Send

_REFUSALS: Final = {HTTPStatus.FORBIDDEN, HTTPStatus.UNPROCESSABLE_ENTITY}


class LimitsMiddleware:
    """Answers floods with 429; whoever holds a good token is not kept out by others' bad ones.

    Args:
        app: The application inside.
        requests_per_s: Requests of one address, over ten seconds.
        refusals_per_min: Of these, requests that are refused; more of them are told to wait.
    """

    def __init__(self, app: ASGIApp, *, requests_per_s: int, refusals_per_min: int) -> None:
        self._app = app
        self._requests = RateLimit.per_second(requests_per_s)
        self._refusals = RateLimit.per_minute(refusals_per_min)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on, or refuse it."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        address = (scope.get("client") or ("",))[0]
        if not await self._requests.take(address):
            await _flood("requests", self._requests)(scope, receive, send)
            return
        counting = counted(
            send,
            rate=self._refusals,
            address=address,
            statuses=_REFUSALS,
            flooded=lambda: _flood("refused requests", self._refusals)(scope, receive, send),
            admitted=lambda: log_refusal(scope),
        )
        await self._app(scope, receive, counting)


def _flood(what: str, rate: RateLimit) -> JSONResponse:
    detail = f"too many {what} from your address; wait a little"
    return problem(HTTPStatus.TOO_MANY_REQUESTS, detail, headers=rate.pause)
