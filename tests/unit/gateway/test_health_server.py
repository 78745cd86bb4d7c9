"""Health and metrics are served under load, with bounded resources."""

from __future__ import annotations

import socket
import threading
from contextlib import ExitStack, contextmanager, suppress
from typing import TYPE_CHECKING
from unittest.mock import Mock

import httpx
import psutil
import pytest
from eskin_gateway.metrics import Metrics
from eskin_gateway.ops.health import Health
from eskin_gateway.ops.health_server import HealthServer
from eskin_gateway.settings import HttpSection

from tests.support.processes import PLAIN, wait_until

if TYPE_CHECKING:
    from collections.abc import Iterator

MOST = 8
DRIPPING = 400
MOST_GROWTH = 8 * 2**20
SLOW = b"GET /healthz HTTP/1.1\r\nHost: here\r\nX-Slow: "


@pytest.fixture
def health() -> Mock:
    """A healthy gateway."""
    return Mock(spec=Health, **{"report.return_value": {"status": "ok", "reasons": []}})


@contextmanager
def serving(health: Health, *, requests_per_s: int = 1000) -> Iterator[HealthServer]:
    section = HttpSection(port=0, connections=MOST, requests_per_s=requests_per_s)
    server = HealthServer(section, health=health, metrics=Metrics())
    server.start()
    try:
        yield server
    finally:
        server.stop()


@pytest.fixture
def server(health: Mock) -> Iterator[HealthServer]:
    with serving(health) as made:
        yield made


def ask(server: HealthServer, path: str, method: str = "GET") -> httpx.Response:
    url = f"http://127.0.0.1:{server.port}{path}"
    with httpx.Client(trust_env=False, timeout=20.0, verify=PLAIN) as client:
        return client.request(method, url)


def is_healthy(server: HealthServer) -> bool:
    """Whether it reports so; it may be busy closing connections."""
    with suppress(httpx.TransportError):
        return ask(server, "/healthz").status_code == 200
    return False


def test_health_is_served_beside_endless_requests(
    health: Mock, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("eskin_gateway.ops.health_server._HEAD_S", 600.0)  # no request times out
    process = psutil.Process()
    with serving(health) as server, ExitStack() as stack:
        assert is_healthy(server)
        before, threads = process.memory_info().rss, set(threading.enumerate())
        for number in range(DRIPPING):
            own = (f"127.0.0.{1 + number % 200}", 0)
            drip = socket.create_connection(("127.0.0.1", server.port), source_address=own)
            stack.enter_context(drip)
            with suppress(OSError):  # it had to give way already
                drip.sendall(SLOW)
            if number % 50 == 0:
                wait_until(lambda: is_healthy(server), "health is served")
        wait_until(lambda: is_healthy(server), "health is served")
        assert len(server._listener.server_state.connections) <= MOST
        assert set(threading.enumerate()) <= threads
        assert process.memory_info().rss - before < MOST_GROWTH


@pytest.mark.parametrize(
    ("path", "method", "status"),
    [
        ("/healthz", "GET", 200),
        ("/metrics", "GET", 200),
        ("/healthz", "HEAD", 200),
        ("/secrets", "GET", 404),
        ("/metrics", "DELETE", 405),
    ],
)
def test_each_response_has_security_headers(
    server: HealthServer, path: str, method: str, status: int
) -> None:
    answer = ask(server, path, method)
    assert answer.status_code == status
    assert answer.headers["x-content-type-options"] == "nosniff"
    assert answer.headers["cache-control"] == "no-store"
    assert "default-src 'none'" in answer.headers["content-security-policy"]
    assert "server" not in answer.headers
    if status >= 400:
        assert answer.headers["content-type"] == "application/problem+json"
        assert answer.json()["status"] == status


@pytest.mark.parametrize("path", ["/healthz", "/metrics"])
def test_other_host_name_is_rejected(server: HealthServer, path: str) -> None:
    url = f"http://127.0.0.1:{server.port}{path}"
    answer = httpx.get(url, headers={"Host": f"evil.example:{server.port}"})
    assert answer.status_code == 421
    assert answer.headers["content-type"] == "application/problem+json"
    assert httpx.get(url, headers={"Host": "localhost:1"}).status_code == 200


def test_body_and_long_head_are_rejected(server: HealthServer) -> None:
    posted = b"POST /healthz HTTP/1.1\r\nHost: localhost\r\nContent-Length: 4\r\n\r\nbody"
    with socket.create_connection(("127.0.0.1", server.port), timeout=20) as connection:
        connection.sendall(posted)
        assert connection.recv(4096).startswith(b"HTTP/1.1 413 ")
    assert ask(server, "/" + "a" * 10_000).status_code == 431
    assert is_healthy(server)


@pytest.fixture
def now(standing_windows: None, monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """The server's clock, advanced by the test; the windows of its rate limit never end."""
    del standing_windows
    instant = [1000.0]
    monkeypatch.setattr("eskin_gateway.ops.health_server.monotonic", lambda: instant[0])
    return instant


def test_flood_gets_429_and_health_is_still_served(health: Mock, now: list[float]) -> None:
    with serving(health, requests_per_s=1) as server:
        answers = [ask(server, "/metrics") for _ in range(11)]
        assert [answer.status_code for answer in answers] == [200] * 10 + [429]
        assert answers[-1].headers["retry-after"] == "10"
        for looks in range(1, 4):
            assert [ask(server, "/healthz").status_code for _ in range(10)] == [200] * 10
            assert health.report.call_count == looks, "asked for at most once a second"
            now[0] += 1.01


def test_degraded_health_is_served_under_a_flood(health: Mock, now: list[float]) -> None:
    with serving(health, requests_per_s=1) as server:
        assert [ask(server, "/healthz").status_code for _ in range(12)] == [200] * 12
        assert health.report.call_count == 10, "once for each that the rate allows"
        health.report.return_value = {"status": "degraded", "reasons": ["broker: away"]}
        now[0] += 1.01
        assert ask(server, "/healthz").status_code == 503
