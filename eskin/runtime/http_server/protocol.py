"""HTTP/1.1 with bounds on what a client may take: time, bytes, connections.

uvicorn waits forever for the end of a head or a body, reads heads of any length, takes as many
connections as come, looks at no ``Host``, and shows no client certificate to the application. The
rest of it, and the answers, are its own.
"""

from __future__ import annotations

import functools
import ssl
from dataclasses import dataclass
from http import HTTPStatus
from ipaddress import IPv4Network, IPv6Network, ip_address
from typing import TYPE_CHECKING, Any, Final, Literal
from urllib.parse import urlsplit

from uvicorn.protocols.http.httptools_impl import HttpToolsProtocol

from eskin.runtime.http_server.connection_limits import (
    CALLER,
    CountedConnection,
    make_room,
    source_name,
)
from eskin.runtime.http_server.problems import MEDIA_TYPE, details, kind_of
from eskin.runtime.http_server.rate_limit import source_of
from eskin.runtime.http_server.websocket import GuardedWebSocket

if TYPE_CHECKING:
    import asyncio
    from collections.abc import Callable

_STALLED_S: Final = 30.0
"""For so long a client may take nothing of a piece of an answer that waits to be sent."""
_UNSENT_BYTES: Final = 16_384
"""What waits to be sent lies with who makes it, who may still think better of it."""
_PROMPT_BYTES: Final = 2048
"""The same where what waits grows stale."""
LOCALHOST: Final = frozenset({"localhost"})
"""As `HttpLimits.hosts`: addresses, and the name that no other machine has."""
PROMPT: Final = "eskin.prompt"
"""Extension of ASGI: an answer that calls its ``begin`` has as little as can be wait to be sent."""
BARE_HEADERS: Final = (
    ("Cache-Control", "no-store"),
    ("Content-Security-Policy", "default-src 'none'; frame-ancestors 'none'"),
    ("X-Content-Type-Options", "nosniff"),
)
"""Of answers with which a browser shall do nothing."""
_DETAILS: Final = {
    400: "this is no HTTP/1.1 request",
    408: "the request came too slowly",
    413: "the body is too long; send less",
    421: "Host is no name of this server; ask by its address, or add the name to its settings",
    431: "request line and headers are too long; send less",
    503: "too many connections; come back later",
}


@dataclass(frozen=True, slots=True)
class HttpLimits:
    """What a listener gives to clients.

    Attributes:
        head_s: Seconds for request line and headers to come, and for the rest of a body that was
            answered already.
        head_bytes: Their length.
        body_s: Seconds in which some of a body must come.
        body_least: How much of it, in bytes.
        body_bytes: A body's length; ``None`` where the application looks after that.
        message_bytes: Length of a client's message on a WebSocket; ``None`` where the application
            has none, and requests to upgrade are ordinary ones.
        connections: Open at once.
        of_one: Of these, of one caller who proved who it is, else from one address, or one IPv6
            network of 64 bit.
        hosts: Names that ``Host`` may have, beside addresses; ``None`` for any, where TLS has
            clients check the name.
        proxies: Networks of reverse proxies, whose forwarded client addresses are trusted.
        forwarded: Header in which they say it, by its name in lower case.
    """

    head_s: float = 10.0
    head_bytes: int = 32_768
    body_s: float = 20.0
    body_least: int = 4096
    body_bytes: int | None = None
    message_bytes: int | None = None
    connections: int = 768
    of_one: int = 256
    hosts: frozenset[str] | None = None
    proxies: tuple[IPv4Network | IPv6Network, ...] = ()
    forwarded: Literal["x-forwarded-for", "forwarded"] = "x-forwarded-for"

    def is_proxy(self, address: str) -> bool:
        """Whether an address is one of `proxies`."""
        try:
            found = ip_address(address.partition("%")[0].removeprefix("::ffff:"))
        except ValueError:
            return False
        return any(found in network for network in self.proxies)


class GuardedProtocol(CountedConnection, HttpToolsProtocol):
    """One connection.

    Args:
        bounds: What it may take.
        others: As uvicorn gives them.
    """

    def __init__(self, *, bounds: HttpLimits, **others: Any) -> None:
        super().__init__(**others)
        self.bounds = bounds
        self._timer: asyncio.TimerHandle | None = None
        self._proxied = False
        self._whole = True  # no request is on its way
        self._silent = True  # so far
        self.idle_since = self.loop.time()
        self._in_head = True
        self._head_bytes = self._body_bytes = self._window_bytes = 0
        self._refusal = HTTPStatus.BAD_REQUEST
        self._tls: dict[str, dict[object, object]] = {}

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]  # TCP
        """Take a connection, if there is room for it."""
        super().connection_made(transport)
        self.limit_unsent(_UNSENT_BYTES, _UNSENT_BYTES)
        address = self.client[0] if self.client else ""
        self._proxied = self.bounds.is_proxy(address)
        self.named = self._proxied
        self.source = None if self._proxied or not address else source_of(address)
        encrypted = transport.get_extra_info("ssl_object")
        if encrypted is not None:
            chain = client_chain(encrypted)
            self._tls = {"tls": {"client_cert_chain": chain}}
            if chain:
                self.source, self.authenticated = source_name("certificate", chain[0]), True
                self.named = True
        if not make_room(self, self.connections, self.bounds):
            self._refuse(HTTPStatus.SERVICE_UNAVAILABLE)
            return
        self._expect(self.bounds.head_s, self._too_slow)

    def connection_lost(self, exc: Exception | None) -> None:
        """It is over."""
        self._expect(None)
        self.resume_writing()
        super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        """Bytes came."""
        if self.transport.is_closing():
            return
        self._silent = False
        if self._in_head:
            self._head_bytes += len(data)
        self._window_bytes += len(data)
        super().data_received(data)
        if self._in_head and self._head_bytes > self.bounds.head_bytes:
            self._refuse(HTTPStatus.REQUEST_HEADER_FIELDS_TOO_LARGE)

    def on_message_begin(self) -> None:
        """A request begins."""
        super().on_message_begin()
        begin = functools.partial(self.limit_unsent, 0, _PROMPT_BYTES)
        self.scope["extensions"] = {
            PROMPT: {"begin": begin},
            CALLER: {"identify": self.identify},
            **self._tls,
        }
        self._in_head, self._whole, self._body_bytes = True, False, 0
        self._expect(self.bounds.head_s, self._too_slow)

    def on_headers_complete(self) -> None:
        """Its head is here."""
        size = len(self.url) + sum(len(name) + len(value) + 4 for name, value in self.headers)
        if size > self.bounds.head_bytes:
            self._stop(HTTPStatus.REQUEST_HEADER_FIELDS_TOO_LARGE)
        self._require_host()
        if self._proxied and self.client is not None:
            self.scope["client"] = (self._forwarded_for(self.client[0]), 0)
        self._in_head, self._head_bytes, self._window_bytes = False, 0, 0
        self._expect(self.bounds.body_s, self._look)
        super().on_headers_complete()

    def on_body(self, body: bytes) -> None:
        """Some of its body is here."""
        self._body_bytes += len(body)
        most = self.bounds.body_bytes
        if most is not None and self._body_bytes > most:
            self._stop(HTTPStatus.REQUEST_ENTITY_TOO_LARGE)
        super().on_body(body)

    def on_message_complete(self) -> None:
        """All of it is here."""
        self._whole = True
        self._expect(None)
        super().on_message_complete()

    def on_response_complete(self) -> None:
        """It was answered; the next one, or the rest of this one, must come soon."""
        super().on_response_complete()
        self.idle_since = self.loop.time()
        if not self.transport.is_closing() and self.cycle.response_complete:
            # What still waits to be sent has as long as any piece.
            unsent = self.transport.get_write_buffer_size()
            self._expect(_STALLED_S if unsent else self.bounds.head_s, self.transport.abort)

    def pause_writing(self) -> None:
        """The client reads more slowly than we answer: the piece that waits has its time."""
        super().pause_writing()
        self.watch_stall(_STALLED_S)

    def resume_writing(self) -> None:
        """It has taken that piece."""
        self.watch_stall(None)
        super().resume_writing()

    def handle_websocket_upgrade(self) -> None:
        """Hand the connection over to the WebSocket protocol."""
        self._expect(None)
        self.watch_stall(None)
        self.ws_protocol_class = functools.partial(  # type: ignore[assignment]  # it is called only
            GuardedWebSocket, upgraded=self, client=self.scope["client"]
        )
        super().handle_websocket_upgrade()
        self.ws_protocol_class = None

    def _should_upgrade_to_ws(self) -> bool:
        """Whether an upgrade is possible: a GET, while no request before it is being answered."""
        answering = self.cycle is not None and not self.cycle.response_complete  # type: ignore[redundant-expr]  # before a request it is None
        served = self.bounds.message_bytes is not None and self.parser.get_method() == b"GET"
        return served and not answering

    def send_400_response(self, msg: str) -> None:
        """Refuse, as problem details (RFC 9457), and end the connection."""
        del msg
        status = self._refusal
        body = details(status, _DETAILS[status], kind=kind_of(status))
        head = (
            f"HTTP/1.1 {status:d} {status.phrase}\r\nContent-Type: {MEDIA_TYPE}\r\n"
            f"Content-Length: {len(body)}\r\nX-Content-Type-Options: nosniff\r\n"
            "Cache-Control: no-store\r\nConnection: close\r\n\r\n"
        )
        self.transport.write(head.encode() + body)
        self.transport.close()

    @property
    def idle(self) -> bool:
        """Whether it waits for a request, or for the rest of one by a client that is unknown."""
        waits = self._in_head or self.cycle.response_complete
        unknown = not self._whole and not self.authenticated
        return (waits or unknown) and not self.transport.is_closing()

    def refuse_for_room(self) -> None:
        """End it, because its caller has too many connections."""
        if self.cycle.response_started:
            self.transport.abort()
        else:
            self._refuse(HTTPStatus.SERVICE_UNAVAILABLE)

    def _require_host(self) -> None:
        """Refuse a name that is not ours, which a browser sends where DNS leads a page here."""
        allowed = self.bounds.hosts
        if allowed is None:
            return
        hosts = [value for name, value in self.headers if name == b"host"]
        if len(hosts) != 1:
            self._stop(HTTPStatus.BAD_REQUEST)
        try:
            name = urlsplit("//" + hosts[0].decode("latin-1")).hostname or ""
        except ValueError:
            name = ""
        if name.removesuffix(".") not in allowed and not _is_address(name):
            self._stop(HTTPStatus.MISDIRECTED_REQUEST)

    def _forwarded_for(self, peer: str) -> str:
        """The client of a proxy: of the hops that it names, the last one that is no proxy."""
        wanted = self.bounds.forwarded.encode()
        hops = b",".join(value for name, value in self.headers if name == wanted)
        last = peer
        for hop in reversed(hops.decode("latin-1").split(",")):
            found = _hop(hop, named=self.bounds.forwarded == "forwarded")
            if found is None:
                break
            last = found
            if not self.bounds.is_proxy(found):
                break
        return last

    def _look(self) -> None:
        """Enough of the body came, or we are who did not read it."""
        if self._window_bytes < self.bounds.body_least and not self.flow.read_paused:
            self._too_slow()
            return
        self._window_bytes = 0
        self._expect(self.bounds.body_s, self._look)

    def _too_slow(self) -> None:
        if self._silent:
            self.transport.abort()
        else:
            self._refuse(HTTPStatus.REQUEST_TIMEOUT)

    def _refuse(self, status: HTTPStatus) -> None:
        if not self.transport.is_closing():
            self._refusal = status
            self.send_400_response("")

    def _stop(self, status: HTTPStatus) -> None:
        """Refuse from within the parser, which knows no other way to end."""
        self._refusal = status
        raise ValueError(_DETAILS[status])

    def _expect(self, seconds: float | None, otherwise: Callable[[], None] | None = None) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        if seconds is not None and otherwise is not None:
            self._timer = self.loop.call_later(seconds, otherwise)


def _is_address(name: str) -> bool:
    try:
        ip_address(name.partition("%")[0])
    except ValueError:
        return False
    return True


def _hop(text: str, *, named: bool) -> str | None:
    """The address of one hop, of ``X-Forwarded-For`` or of ``Forwarded`` (RFC 7239, section 4)."""
    text = text.strip()
    if named:
        pairs = (part.partition("=") for part in text.split(";"))
        found = [
            value.strip().strip('"') for name, _, value in pairs if name.strip().lower() == "for"
        ]
        text = found[0] if len(found) == 1 else ""
    try:
        host = text if _is_address(text) else urlsplit("//" + text).hostname or ""
    except ValueError:
        return None
    return host if _is_address(host) else None


def client_chain(encrypted: Any) -> tuple[str, ...]:
    """The certificates by which a client was verified, its own first.

    As ASGI's TLS extension gives them in ``client_cert_chain``; uvicorn does not.

    Args:
        encrypted: The connection's `ssl.SSLObject`, after its handshake.

    Returns:
        PEM of each; none where the client was asked for no certificate, or where the session was
        resumed, in which TLS carries no chain.
    """
    # Public from Python 3.13 on, where it gives DER.
    get = getattr(encrypted, "get_verified_chain", None)
    if get is None:
        found = encrypted._sslobj.get_verified_chain() or ()  # noqa: SLF001 - see above
        return tuple(part.public_bytes() for part in found)
    return tuple(ssl.DER_cert_to_PEM_cert(part) for part in get())
