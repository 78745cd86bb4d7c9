"""A listener: one uvicorn server on a socket of its own, with TLS where it has a certificate.

uvicorn knows nothing of a connection before its TLS handshake. A client that never begins one
would hold as many sockets as the process may open. So the listener accepts connections itself, and
bounds those whose handshake is not over.
"""

from __future__ import annotations

import asyncio
import contextlib
import functools
import logging
import os
import socket
from typing import TYPE_CHECKING, Final

import uvicorn

from eskin.errors import SettingsError
from eskin.runtime.http_server.connection_limits import make_handshake_room
from eskin.runtime.http_server.protocol import GuardedProtocol
from eskin.runtime.http_server.rate_limit import source_of
from eskin.runtime.http_server.websocket import PING_S, PONG_S

if TYPE_CHECKING:
    import ssl
    from collections.abc import Iterator, Sequence

    from starlette.types import ASGIApp

    from eskin.runtime.http_server.protocol import HttpLimits

log = logging.getLogger(__name__)

_GRACE_SECONDS: Final = 10
_AT_ONCE: Final = 16
"""Connections that are accepted before others have a turn."""
_PAUSE_S: Final = 1.0


class Listener(uvicorn.Server):
    """A server whose signals and whose state are the caller's.

    Of connections whose handshake is not over, the one that began first is ended where there are
    too many of one address, or in all: an honest client takes an instant only. How many may be
    open after that the protocol decides.

    Args:
        app: What answers.
        bound: Where it listens; it is taken over.
        context: For TLS; ``None`` for plain HTTP.
        bounds: What a client may take; a handshake has as long as a head.
        headers: Added to each answer of the application.

    Attributes:
        ready: Set once it accepts.
    """

    def __init__(
        self,
        app: ASGIApp,
        bound: socket.socket,
        *,
        context: ssl.SSLContext | None,
        bounds: HttpLimits,
        headers: Sequence[tuple[str, str]] = (),
    ) -> None:
        config = uvicorn.Config(
            app,
            http=functools.partial(GuardedProtocol, bounds=bounds),  # type: ignore[arg-type]
            loop="asyncio",
            ws="none",  # the protocol upgrades by itself
            ws_max_size=bounds.message_bytes or 0,
            ws_ping_interval=PING_S,
            ws_ping_timeout=PONG_S,
            ws_per_message_deflate=False,
            lifespan="off",
            headers=list(headers),
            log_config=None,
            access_log=False,
            proxy_headers=False,
            server_header=False,
            timeout_graceful_shutdown=_GRACE_SECONDS,
        )
        config.load()
        config.ssl = context
        super().__init__(config)
        self.servers = []
        self._bound = bound
        self._bounds = bounds
        self._handshakes: dict[asyncio.Task[None], str] = {}
        self.ready = asyncio.Event()

    @property
    def url(self) -> str:
        """Where it is reached."""
        host, port = self._bound.getsockname()[:2]
        scheme = "http" if self.config.ssl is None else "https"
        return f"{scheme}://{f'[{host}]' if ':' in host else host}:{port}"

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """Accept, and say so."""
        del sockets
        self._bound.setblocking(False)  # noqa: FBT003 - its only parameter
        self._listen()
        self.started = True
        self.ready.set()

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """Accept no more, end handshakes, and let requests end."""
        del sockets
        asyncio.get_running_loop().remove_reader(self._bound)
        self._bound.close()
        handshakes = list(self._handshakes)
        for task in handshakes:
            task.cancel()
        await asyncio.gather(*handshakes, return_exceptions=True)
        await super().shutdown()

    @contextlib.contextmanager
    def capture_signals(self) -> Iterator[None]:
        """Leave signals to the process."""
        yield

    def _listen(self) -> None:
        if self._bound.fileno() >= 0:  # not closed meanwhile
            asyncio.get_running_loop().add_reader(self._bound, self._accept)

    def _accept(self) -> None:
        loop = asyncio.get_running_loop()
        for _ in range(_AT_ONCE):
            try:
                arrived, address = self._bound.accept()
            except (BlockingIOError, InterruptedError, ConnectionAbortedError):
                return
            except OSError as error:  # the process has no descriptors or memory left
                log.warning("no connection can be accepted, trying again: %s", error)
                loop.remove_reader(self._bound)
                loop.call_later(_PAUSE_S, self._listen)
                return
            self._admit(arrived, address[0])

    def _admit(self, arrived: socket.socket, address: str) -> None:
        connected = len(self.server_state.connections)
        if not make_handshake_room(self._handshakes, address, self._bounds, connected=connected):
            arrived.close()
            return
        task = asyncio.create_task(self._shake_hands(arrived))
        self._handshakes[task] = source_of(address)

        def forget(task: asyncio.Task[None]) -> None:
            self._handshakes.pop(task, None)
            if task.cancelled():  # also where it had not begun
                arrived.close()

        task.add_done_callback(forget)

    async def _shake_hands(self, arrived: socket.socket) -> None:
        context = self.config.ssl
        # The client left, was too slow, or speaks no TLS.
        with contextlib.suppress(OSError):
            await asyncio.get_running_loop().connect_accepted_socket(
                self._protocol,
                arrived,
                ssl=context,
                ssl_handshake_timeout=None if context is None else self._bounds.head_s,
            )

    def _protocol(self) -> asyncio.Protocol:
        made: asyncio.Protocol = self.config.http_protocol_class(  # type: ignore[call-arg]
            config=self.config, server_state=self.server_state, app_state=self.lifespan.state
        )
        return made


def bind(section: str, host: str, port: int) -> socket.socket:
    """Take an address.

    Raises:
        SettingsError: It cannot be had.
    """
    try:
        family = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0][0]
        bound = socket.create_server((host, port), family=family, backlog=2048)
    except OSError as error:
        unknown = isinstance(error, socket.gaierror)
        name = f"{section}.host" if unknown else f"{section}.port"
        why = error.strerror if unknown else os.strerror(error.errno or 0)
        remedy = "" if unknown else "; choose another port, or 0 for any free one"
        raise SettingsError(name, f"{host}:{port} cannot be listened on: {why}{remedy}") from error
    # What is accepted inherits it. asyncio sets it for sockets alone that name their protocol, and
    # without it the body of each answer waits 40 ms for the peer to acknowledge its head.
    bound.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    return bound
