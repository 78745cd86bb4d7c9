"""A browser opens the stream of frames from our page, and from no other page."""

from __future__ import annotations

import threading
from contextlib import contextmanager
from datetime import timedelta
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import TYPE_CHECKING, Any

import cbor2
import pytest
from eskin_cloud.access import create_login_code
from eskin_cloud.store import Store
from playwright.sync_api import sync_playwright

from tests.unit.cloud.service import Service
from tests.unit.dashboard.browsing import launch

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from tests.support.identities import Identities

_OPEN = """
(address) => new Promise((done) => {
  const socket = new WebSocket(address);
  socket.binaryType = "arraybuffer";
  socket.onmessage = ({data}) => done([...new Uint8Array(data)]);
  socket.onclose = ({code}) => done(code);
})
"""
_REFUSED = 1006
"""How a browser names a WebSocket that was never opened."""


class _Page(BaseHTTPRequestHandler):
    """An empty page."""

    def do_GET(self) -> None:
        self.send_response(200)
        self.end_headers()

    def log_message(self, *_: Any) -> None:
        """Say nothing."""


@contextmanager
def other_site() -> Iterator[str]:
    """A page of the same host, whose port is another one: cookies are sent from there."""
    with ThreadingHTTPServer(("127.0.0.1", 0), _Page) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        yield f"http://127.0.0.1:{server.server_port}"
        server.shutdown()
        thread.join()


@pytest.mark.nightly
def test_browser_opens_a_stream_from_our_page_alone(tmp_path: Path, identities: Identities) -> None:
    with Service(tmp_path / "cloud", identities) as service:
        with Store(service.place) as store:
            code = create_login_code(store, lifetime=timedelta(minutes=5))
        ours = f"http://127.0.0.1:{service.port}"
        address = f"ws://127.0.0.1:{service.port}/api/v1/live"
        with sync_playwright() as playwright, other_site() as theirs:
            browser = launch(playwright)
            page = browser.new_page()
            page.goto(f"{ours}/login?code={code}")
            page.goto(f"{ours}/healthz")  # with the headers of each of our pages
            kind, _, skipped = cbor2.loads(bytes(page.evaluate(_OPEN, address)))
            assert (kind, skipped) == ("lagging", 0)
            page.goto(theirs)
            assert page.evaluate(_OPEN, address) == _REFUSED
            page.goto(f"{ours}/readyz")  # the session is still good
            assert isinstance(page.evaluate(_OPEN, address), list)
            browser.close()
