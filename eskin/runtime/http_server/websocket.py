"""WebSocket (RFC 6455) with bounds on what a client may take and send.

uvicorn counts no WebSocket, reads messages as fast as they come, answers each ping whether or not
the client reads the answers, and waits forever where a client takes nothing.
"""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING, Any, Final, cast

from uvicorn.protocols.utils import ClientDisconnected
from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol

from eskin.runtime.http_server.connection_limits import CALLER, CountedConnection

if TYPE_CHECKING:
    from uvicorn._types import ASGISendEvent
    from websockets.frames import Frame

PING_S: Final = 20.0
"""Seconds between two pings."""
PONG_S: Final = 20.0
"""Seconds in which a ping must be answered."""
MESSAGES_PER_S: Final = 8
BYTES_PER_S: Final = 16_384
WINDOW_BYTES: Final = 131_072
"""So much a client may leave unread; what waits in its buffers grows stale."""
_PROBE_BYTES: Final = 32_768
"""After so much a ping asks how far the client has read."""
_PROBE: Final = b"probe"
_POLICY_VIOLATION: Final = 1008
_STALLED_S: Final = 30.0
"""For so long a client may take nothing of what waits to be sent."""
_UNSENT_BYTES: Final = 2048
"""What waits in the kernel grows stale."""


class GuardedWebSocket(CountedConnection, WebSocketsSansIOProtocol):
    """A connection after its upgrade.

    Args:
        upgraded: The HTTP connection.
        client: Address and port of the client, or of the one that a proxy names.
        others: As uvicorn gives them.
    """

    def __init__(
        self, *, upgraded: CountedConnection, client: tuple[str, int] | None, **others: Any
    ) -> None:
        super().__init__(**others)
        self.bounds = upgraded.bounds
        self.source, self.authenticated = upgraded.source, upgraded.authenticated
        self.named, self.idle_since = upgraded.named, upgraded.idle_since
        self._asked_for = client
        self._sent = self._read = self._probed = 0
        self._room = asyncio.Event()
        self._room.set()
        self._second = 0.0
        self._messages = self._bytes = 0

    @property
    def idle(self) -> bool:
        """Never: the client that opened it wants what comes."""
        return False

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Take over a connection."""
        super().connection_made(transport)
        self.client = self._asked_for
        self.limit_unsent(0, _UNSENT_BYTES)

    def connection_lost(self, exc: Exception | None) -> None:
        """It is over."""
        self.watch_stall(None)
        self._room.set()
        super().connection_lost(exc)

    def pause_writing(self) -> None:
        """The client reads more slowly than the application sends."""
        super().pause_writing()
        self.watch_stall(_STALLED_S)

    def resume_writing(self) -> None:
        """It has taken what waited."""
        self.watch_stall(None)
        super().resume_writing()

    def data_received(self, data: bytes) -> None:
        """Bytes came; the first ones are the head of the request."""
        if not self.handshake_initiated:
            super().data_received(data)
            if not self.handshake_initiated:  # the head is none that the library reads
                self.transport.abort()
            return
        if self._exceeds(octets=len(data)):
            self._end(_POLICY_VIOLATION, f"more than {BYTES_PER_S} bytes a second")
        elif not self.close_sent or self.close_timer is not None:
            super().data_received(data)

    def send_receive_event_to_app(self) -> None:
        """A message came."""
        if self._exceeds(messages=1):
            self._end(_POLICY_VIOLATION, f"more than {MESSAGES_PER_S} messages a second")
            return
        super().send_receive_event_to_app()

    def handle_parser_exception(self) -> None:
        """The client broke the protocol."""
        if self.conn.close_sent is None:  # before the upgrade was answered
            self.transport.abort()
        else:
            super().handle_parser_exception()

    async def run_asgi(self) -> None:
        """Run the application."""
        extensions = cast("dict[str, Any]", self.scope["extensions"])
        extensions[CALLER] = {"identify": self.identify}
        await super().run_asgi()

    async def send(self, message: ASGISendEvent) -> None:
        """Send a message of the application, once the client took those before.

        The kernels of both sides hold megabytes that a slow client has not read. A client answers a
        ping when it has read all before it, so it never leaves more than a window unread.
        """
        await self._room.wait()
        await self.writable.wait()
        if self.close_sent and self.initial_response is None:
            raise ClientDisconnected
        await super().send(message)
        # A refusal completes the handshake, too; uvicorn logs it as a fault otherwise.
        self.handshake_complete |= self.close_sent
        if message["type"] == "websocket.send" and (data := message.get("bytes")) is not None:
            self._sent += len(data)
            self._probe()

    def handle_pong(self, event: Frame) -> None:
        """The client answered a ping, of ours or of uvicorn's."""
        if bytes(event.data) != _PROBE:
            super().handle_pong(event)
        elif self._probed:
            self._read, self._probed = self._probed, 0
            self._probe()

    def _probe(self) -> None:
        """Ask how far the client has read, where that is not known well enough."""
        unread = self._sent - self._read
        if unread >= _PROBE_BYTES and not self._probed and not self.close_sent:
            self._probed = self._sent
            self.conn.send_ping(_PROBE)
            self.transport.write(b"".join(self.conn.data_to_send()))
        if unread < WINDOW_BYTES:
            self._room.set()
        else:
            self._room.clear()

    def refuse_for_room(self) -> None:
        """End it, because its caller has too many connections."""
        if self.handshake_complete:
            self._end(_POLICY_VIOLATION, "too many connections")
        else:
            self.transport.abort()

    def _exceeds(self, *, octets: int = 0, messages: int = 0) -> bool:
        """Count what came; gives whether it is more than a client may send in a second."""
        now = self.loop.time()
        if now - self._second >= 1.0:
            self._second, self._messages, self._bytes = now, 0, 0
        self._messages += messages
        self._bytes += octets
        return self._messages > MESSAGES_PER_S or self._bytes > BYTES_PER_S

    def _end(self, code: int, reason: str) -> None:
        if self.close_sent:
            return
        self.stop_keepalive()
        self.conn.fail(code, reason)
        self.transport.write(b"".join(self.conn.data_to_send()))
        self.close_sent = True
        self.transport.close()
