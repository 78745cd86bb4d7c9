"""Health and figures over plain HTTP, on loopback only."""

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
_FRESH_S: Final = 1.0


class HealthServer:
    """Serves ``/healthz`` and ``/metrics``.

    On loopback nobody can be told from others by their address. So where all connections are taken,
    the one gives way that has waited longest for a request to come.

    Args:
        settings: Where to listen, and how much at most.
        health: Asked for ``/healthz``.
        metrics: Shown by ``/metrics``.

    Raises:
        SettingsError: The address cannot be listened on.
    """

    def __init__(self, settings: HttpSection, *, health: Health, metrics: Metrics) -> None:
        bound = bind("http", settings.host, settings.port)
        self.port: Final = int(bound.getsockname()[1])
        bounds = HttpLimits(
            head_s=_HEAD_S,
            head_bytes=_HEAD_BYTES,
            body_bytes=0,
            connections=settings.connections,
            of_one=settings.connections,
            hosts=LOCALHOST,
        )
        pages = _Pages(health, metrics, RateLimit.per_second(settings.requests_per_s))
        self._listener = Listener(pages, bound, context=None, bounds=bounds, headers=BARE_HEADERS)
        self._thread = Thread(target=self._serve, name="monitor", daemon=True)

    def start(self) -> None:
        """Serve in a thread."""
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
        self._told: dict[str, Any] | None = None
        self._told_at = 0.0

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request."""
        del receive
        host = (scope.get("client") or ("",))[0]
        allowed, health = await self._rate.take(host), scope["path"] == "/healthz"
        # Whoever looks after us asks from the address of all others here, and needs an answer.
        if not allowed and not health:
            said = "too many requests; wait a little"
            await _refuse(send, HTTPStatus.TOO_MANY_REQUESTS, said, self._rate.pause)
        elif scope["method"] not in {"GET", "HEAD"}:
            ways = {"Allow": "GET, HEAD"}
            await _refuse(send, HTTPStatus.METHOD_NOT_ALLOWED, "only GET is possible here", ways)
        elif health:
            report = self._report(fresh=allowed)
            status = HTTPStatus.SERVICE_UNAVAILABLE if report["reasons"] else HTTPStatus.OK
            await _answer(send, status, "application/json", orjson.dumps(report))
        elif scope["path"] == "/metrics":
            figures = generate_latest(self._metrics.registry)
            await _answer(send, HTTPStatus.OK, CONTENT_TYPE_LATEST, figures)
        else:
            await _refuse(send, HTTPStatus.NOT_FOUND, "there are only /healthz and /metrics")

    def _report(self, *, fresh: bool) -> dict[str, Any]:
        """How the gateway fares; as a moment ago, where too many ask."""
        now = monotonic()
        if fresh or self._told is None or now > self._told_at + _FRESH_S:
            self._told, self._told_at = self._health.report(), now
        return self._told


async def _refuse(
    send: Send, status: HTTPStatus, detail: str, more: Mapping[str, str] | None = None
) -> None:
    """Answer with problem details (RFC 9457)."""
    await _answer(send, status, MEDIA_TYPE, details(status, detail), more)


async def _answer(
    send: Send,
    status: HTTPStatus,
    kind: str,
    body: bytes,
    more: Mapping[str, str] | None = None,
) -> None:
    headers = {"Content-Type": kind, "Content-Length": str(len(body)), **(more or {})}
    raw = [(name.lower().encode(), value.encode()) for name, value in headers.items()]
    await send({"type": "http.response.start", "status": status, "headers": raw})
    await send({"type": "http.response.body", "body": body})
