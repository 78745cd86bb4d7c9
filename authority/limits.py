"""How often one address may ask the CA service."""

from __future__ import annotations

from http import HTTPStatus
from typing import TYPE_CHECKING, Final

from fastapi.responses import JSONResponse

from eskin.limiting import Rate

if TYPE_CHECKING:
    from starlette.types import ASGIApp, Message, Receive, Scope, Send

_SPAN_S: Final = 10
_MINUTE_S: Final = 60
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
        self._requests = Rate(requests_per_s * _SPAN_S, _SPAN_S)
        self._refusals = Rate(refusals_per_min, _MINUTE_S)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on, or refuse it."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        address = (scope.get("client") or ("",))[0]
        if not await self._requests.take(address):
            await _flood("requests", _SPAN_S)(scope, receive, send)
            return
        flooded = False

        async def sending(message: Message) -> None:
            nonlocal flooded
            if message.get("status") in _REFUSALS:
                flooded = not await self._refusals.take(address)
                if flooded:
                    await _flood("refused requests", _MINUTE_S)(scope, receive, send)
            if not flooded:
                await send(message)

        await self._app(scope, receive, sending)


def _flood(what: str, seconds: int) -> JSONResponse:
    status = HTTPStatus.TOO_MANY_REQUESTS
    said = {"type": "about:blank", "title": status.phrase, "status": int(status)}
    return JSONResponse(
        said | {"detail": f"too many {what} from your address; wait a little"},
        status_code=status,
        headers={"Retry-After": str(seconds)},
        media_type="application/problem+json",
    )
