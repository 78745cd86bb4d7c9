"""Health and figures over plain HTTP, on loopback only."""

from __future__ import annotations

import logging
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from threading import Thread
from typing import TYPE_CHECKING, Any

import orjson
from prometheus_client import CONTENT_TYPE_LATEST, generate_latest

from eskin.errors import SettingsError

if TYPE_CHECKING:
    from gateway.counters import Counters
    from gateway.health import Health
    from gateway.settings import HttpSection

log = logging.getLogger(__name__)


class Monitor:
    """Serves ``/healthz`` and ``/metrics``.

    Args:
        settings: Where to listen.
        health: Asked for ``/healthz``.
        counters: Shown by ``/metrics``.

    Raises:
        SettingsError: The address cannot be listened on.
    """

    def __init__(self, settings: HttpSection, *, health: Health, counters: Counters) -> None:
        class Handler(_Handler):
            pass

        Handler.health = health
        Handler.counters = counters
        try:
            self._server = _Server((settings.host, settings.port), Handler)
        except OSError as error:
            raise SettingsError(
                "http.port",
                f"{settings.host}:{settings.port} cannot be listened on: {error.strerror}; "
                "choose another port, or 0 for any free one",
            ) from error
        self._thread = Thread(
            target=self._server.serve_forever, args=(0.1,), name="monitor", daemon=True
        )

    @property
    def port(self) -> int:
        """The port that it listens on."""
        return int(self._server.server_address[1])

    def start(self) -> None:
        """Serve in a thread."""
        self._thread.start()

    def stop(self) -> None:
        """End the thread."""
        self._server.shutdown()
        self._server.server_close()
        self._thread.join()


class _Server(ThreadingHTTPServer):
    daemon_threads = True

    def handle_error(self, request: Any, client_address: Any) -> None:
        log.debug("monitor: connection of %s broke off (%r)", client_address, request)


class _Handler(BaseHTTPRequestHandler):
    health: Health
    counters: Counters
    timeout = 5.0

    def do_GET(self) -> None:
        """Answer the two pages."""
        if self.path == "/healthz":
            report = self.health.report()
            good = not report["reasons"]
            status = HTTPStatus.OK if good else HTTPStatus.SERVICE_UNAVAILABLE
            self._answer(status, "application/json", orjson.dumps(report))
        elif self.path == "/metrics":
            figures = generate_latest(self.counters.registry)
            self._answer(HTTPStatus.OK, CONTENT_TYPE_LATEST, figures)
        else:
            self._answer(HTTPStatus.NOT_FOUND, "text/plain", b"only /healthz and /metrics\n")

    def _answer(self, status: HTTPStatus, kind: str, body: bytes) -> None:
        self.send_response(status)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, format: str, *args: Any) -> None:  # noqa: A002 - the base class's name
        log.debug("monitor: %s", format % args)
