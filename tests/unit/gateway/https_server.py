"""An HTTPS server in threads, which goes away at once, whatever its peers do."""

from __future__ import annotations

import socket
import ssl
import sys
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from threading import Lock, Thread
from typing import TYPE_CHECKING, Protocol

from eskin.identity import server_context

if TYPE_CHECKING:
    from collections.abc import Mapping

    from eskin.identity import Identity


class Respond(Protocol):
    """Answers a POST: status, headers and body."""

    def __call__(
        self, path: str, headers: Mapping[str, str], body: bytes, /
    ) -> tuple[int, dict[str, str], bytes]:
        """Answer."""
        ...


class HttpsServer(ThreadingHTTPServer):
    """Listens from the start until it is closed."""

    # Closing waits for the threads of connections.
    daemon_threads = False
    request_queue_size = 64

    def __init__(
        self, identity: Identity, port: int, respond: Respond, *, clients: bool = False
    ) -> None:
        self.respond = respond
        self._context = server_context(identity.directory, client_certificates=clients)
        self._open: set[socket.socket] = set()
        self._lock = Lock()
        super().__init__(("127.0.0.1", port), _Handler)
        self._thread = Thread(target=self.serve_forever, args=(0.02,), daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End every connection, and listen no more."""
        self.shutdown()
        self._thread.join()
        with self._lock:
            for peer in self._open:
                _shut(peer)
        self.server_close()

    def get_request(self) -> tuple[socket.socket, object]:
        """Accept a connection; its thread does the handshake."""
        plain, address = super().get_request()
        peer = self._context.wrap_socket(plain, server_side=True, do_handshake_on_connect=False)
        with self._lock:
            self._open.add(peer)
        return peer, address

    def shutdown_request(self, request: object) -> None:
        """End a connection."""
        assert isinstance(request, ssl.SSLSocket)
        with self._lock:
            self._open.discard(request)
        _shut(request)
        request.close()

    def handle_error(self, request: object, client_address: object) -> None:
        """Report errors other than a lost connection."""
        if not isinstance(sys.exc_info()[1], OSError):
            super().handle_error(request, client_address)  # type: ignore[arg-type]  # as given


def _shut(peer: socket.socket) -> None:
    try:
        peer.shutdown(socket.SHUT_RDWR)
    except OSError:
        return  # It is gone already.


class _Handler(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    server: HttpsServer

    def do_POST(self) -> None:
        length = int(self.headers["content-length"])
        body = self.rfile.read(length)
        if len(body) < length:
            self.close_connection = True
            return
        headers = {name.lower(): value for name, value in self.headers.items()}
        status, more, answer = self.server.respond(self.path, headers, body)
        self.send_response(status)
        for name, value in {**more, "content-length": str(len(answer))}.items():
            self.send_header(name, value)
        self.end_headers()
        self.wfile.write(answer)

    def log_message(self, *_: object) -> None:
        """Log nothing."""
