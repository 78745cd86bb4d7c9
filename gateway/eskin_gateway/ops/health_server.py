"""Serves health and metrics over plain HTTP, on loopback only."""

from __future__ import annotations

import asyncio
from http import HTTPStatus
from threading import Thread
from time import monotonic
from typing import TYPE_CHECKING, Any, Final

import orjson
from prometheus_client import CONTENT_TYPE_LATEST, generate_latest

from eskin.runtime.http_server.listener import Listener, bind
from eskin.runtime.http_server.problems import MEDIA_TYPE, details
from eskin.runtime.http_server.protocol import BARE_HEADERS, LOCALHOST, HttpLimits
from eskin.runtime.http_server.rate_limit import RateLimit

if TYPE_CHECKING:
    from collections.abc import Mapping

    from starlette.types import Receive, Scope, Send

    from eskin_gateway.metrics import Metrics
    from eskin_gateway.ops.health import Health
    from eskin_gateway.settings import HttpSection

_HEAD_S: Final = 5.0
_HEAD_BYTES: Final = 8192
_MAX_AGE_S: Final = 1.0


class HealthServer:
    """Serves ``/healthz`` and ``/metrics``.

    On loopback all clients have the same address. If all connections are taken, the one that has
    been idle longest is closed.

    Args:
        settings: Address and limits.
        health: Makes the report of ``/healthz``.
        metrics: The metrics of ``/metrics``.

    Raises:
        SettingsError: The server cannot listen on the address.
    """

    def __init__(self, settings: HttpSection, *, health: Health, metrics: Metrics) -> None:
        bound = bind("http", settings.host, settings.port)
        self.port: Final = int(bound.getsockname()[1])
        limits = HttpLimits(
            head_s=_HEAD_S,
            head_bytes=_HEAD_BYTES,
            body_bytes=0,
            connections=settings.connections,
            of_one=settings.connections,
            hosts=LOCALHOST,
        )
        pages = _Pages(health, metrics, RateLimit.per_second(settings.requests_per_s))
        self._listener = Listener(pages, bound, context=None, bounds=limits, headers=BARE_HEADERS)
        self._thread = Thread(target=self._serve, name="health_server", daemon=True)

    def start(self) -> None:
        """Start the thread."""
        self._thread.start()

    def stop(self) -> None:
        """End the thread."""
        self._listener.should_exit = True
        self._thread.join()

    def _serve(self) -> None:
        asyncio.run(self._listener.serve())


class _Pages:
    """The two pages, as an ASGI application."""

    def __init__(self, health: Health, metrics: Metrics, rate: RateLimit) -> None:
        self._health = health
        self._metrics = metrics
        self._rate = rate
        self._cached: dict[str, Any] | None = None
        self._cached_at = 0.0

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handle a request."""
        del receive
        host = (scope.get("client") or ("",))[0]
        allowed, health = await self._rate.take(host), scope["path"] == "/healthz"
        # A flood from the same address must not hide the health from a supervisor.
        if not allowed and not health:
            detail = "too many requests; retry later"
            await _send_problem(send, HTTPStatus.TOO_MANY_REQUESTS, detail, self._rate.pause)
        elif scope["method"] not in {"GET", "HEAD"}:
            headers = {"Allow": "GET, HEAD"}
            detail = "only GET is allowed"
            await _send_problem(send, HTTPStatus.METHOD_NOT_ALLOWED, detail, headers)
        elif health:
            report = self._report(cached=not allowed)
            status = HTTPStatus.SERVICE_UNAVAILABLE if report["reasons"] else HTTPStatus.OK
            await _send(send, status, "application/json", orjson.dumps(report))
        elif scope["path"] == "/metrics":
            text = generate_latest(self._metrics.registry)
            await _send(send, HTTPStatus.OK, CONTENT_TYPE_LATEST, text)
        else:
            await _send_problem(send, HTTPStatus.NOT_FOUND, "only /healthz and /metrics exist")

    def _report(self, *, cached: bool) -> dict[str, Any]:
        """The health report, or the last one if it is recent enough."""
        now = monotonic()
        if not cached or self._cached is None or now > self._cached_at + _MAX_AGE_S:
            self._cached, self._cached_at = self._health.report(), now
        return self._cached


async def _send_problem(
    send: Send, status: HTTPStatus, detail: str, headers: Mapping[str, str] | None = None
) -> None:
    """Send problem details (RFC 9457)."""
    await _send(send, status, MEDIA_TYPE, details(status, detail), headers)


async def _send(
    send: Send,
    status: HTTPStatus,
    media_type: str,
    body: bytes,
    headers: Mapping[str, str] | None = None,
) -> None:
    every = {"Content-Type": media_type, "Content-Length": str(len(body)), **(headers or {})}
    raw = [(name.lower().encode(), value.encode()) for name, value in every.items()]
    await send({"type": "http.response.start", "status": status, "headers": raw})
    await send({"type": "http.response.body", "body": body})
