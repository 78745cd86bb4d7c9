"""Headers that every answer carries, and the count of answers."""

from __future__ import annotations

from http import HTTPStatus
from typing import TYPE_CHECKING, Final

from starlette.datastructures import MutableHeaders

if TYPE_CHECKING:
    from prometheus_client import Counter
    from starlette.types import ASGIApp, Message, Receive, Scope, Send

CONTENT_POLICY: Final = (
    "default-src 'self'; base-uri 'none'; form-action 'self'; "
    "frame-ancestors 'none'; object-src 'none'"
)
_ALWAYS: Final = {
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Permissions-Policy": "camera=(), geolocation=(), microphone=()",
}
_HSTS: Final = "max-age=31536000"
_METHODS: Final = frozenset({"GET", "POST", "HEAD", "OPTIONS", "PUT", "DELETE", "PATCH"})


class HeadersMiddleware:
    """Adds the headers that keep browsers from harm.

    Args:
        app: The application inside.
        secure: Whether it is served by HTTPS.
        requests: Counts answers by method and status.
        least_status: Of answers that are counted.
    """

    def __init__(
        self, app: ASGIApp, *, secure: bool, requests: Counter, least_status: int = 0
    ) -> None:
        self._app = app
        self._least_status = least_status
        self._headers = _ALWAYS | ({"Strict-Transport-Security": _HSTS} if secure else {})
        self._requests = requests

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on."""
        if scope["type"] not in {"http", "websocket"}:
            await self._app(scope, receive, send)
            return

        async def sending(message: Message) -> None:
            kind = message["type"].removeprefix("websocket.")
            if kind == "http.response.start":
                headers = MutableHeaders(scope=message)
                for name, value in self._headers.items():
                    headers[name] = value
                headers.setdefault("Cache-Control", "no-store")
                headers.setdefault("Content-Security-Policy", CONTENT_POLICY)
                self._count(scope, message["status"])
            elif kind == "accept":
                self._count(scope, HTTPStatus.SWITCHING_PROTOCOLS)
            await send(message)

        await self._app(scope, receive, sending)

    def _count(self, scope: Scope, status: int) -> None:
        method = scope.get("method", "GET")  # which a WebSocket's handshake is
        if status >= self._least_status:
            self._requests.labels(method if method in _METHODS else "other", str(int(status))).inc()
