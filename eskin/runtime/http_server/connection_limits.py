"""Limit the open connections of a listener: of one client, of one caller, and in all."""

from __future__ import annotations

import hashlib
import socket
from abc import abstractmethod
from typing import TYPE_CHECKING, Any, Final

from eskin.runtime.http_server.rate_limit import source_of

if TYPE_CHECKING:
    import asyncio
    from collections.abc import Iterable

    from eskin.runtime.http_server.protocol import HttpLimits

CALLER: Final = "eskin.caller"
"""Extension of ASGI: its ``identify`` counts the connection for a caller that proved its name."""
MARGIN: Final = 32
"""So many connections above the limit reach the protocol, which ends an idle one for each."""


class CountedConnection:
    """What HTTP and WebSocket connections of a listener have in common.

    Attributes:
        bounds: What a client may take.
        source: Whose connections are counted: a caller that proved its name, else see
            `source_of`; ``None`` for a proxy, which asks for many.
        authenticated: Whether the caller proved its name.
        named: Whether its source is final: a proxy, or a client certificate.
        idle_since: When it began, or was last answered; the event loop's time.
    """

    transport: asyncio.Transport
    loop: asyncio.AbstractEventLoop
    connections: set[Any]
    bounds: HttpLimits
    source: str | None = None
    authenticated = False
    named = False
    idle_since = 0.0
    _stall: asyncio.TimerHandle | None = None

    @property
    @abstractmethod
    def idle(self) -> bool:
        """Whether it may be closed to make room for another connection."""

    @abstractmethod
    def refuse_for_room(self) -> None:
        """End it, because its caller has too many connections."""

    def identify(self, caller: str) -> None:
        """Count this connection for a caller that proved its name; from any thread."""
        source = source_name("caller", caller)
        if self.source != source and not self.named:
            self.loop.call_soon_threadsafe(self._count_for, source)

    def _count_for(self, source: str) -> None:
        self.source, self.authenticated = source, True
        if not self.transport.is_closing() and not make_room(self, self.connections, self.bounds):
            self.refuse_for_room()

    def limit_unsent(self, ours: int, kernel: int) -> None:
        """Have an answer wait when so many bytes do, here or in the kernel."""
        if self.transport.is_closing():  # the client has gone, and the socket with it
            return
        self.transport.set_write_buffer_limits(ours)
        connection = self.transport.get_extra_info("socket")
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NOTSENT_LOWAT, kernel)

    def watch_stall(self, seconds: float | None) -> None:
        """Abort after so many seconds, unless called again; ``None``: the client takes data."""
        if self._stall is not None:
            self._stall.cancel()
            self._stall = None
        if seconds is not None:
            self._stall = self.loop.call_later(seconds, self.transport.abort)


def source_name(kind: str, secret: str) -> str:
    """Whose limit a connection counts towards; it contains no secret."""
    return f"{kind} {hashlib.sha256(secret.encode('utf-8', 'surrogatepass')).hexdigest()}"


def make_room(
    connection: CountedConnection, connections: Iterable[CountedConnection], limits: HttpLimits
) -> bool:
    """End the longest idle connection where there are too many; returns whether there is room.

    Args:
        connection: The new one.
        connections: All of the listener.
        limits: The most of one client, and in all.
    """
    open_ones = (each for each in connections if not each.transport.is_closing())
    others = [each for each in open_ones if each is not connection]
    same = [each for each in others if each.source == connection.source is not None]
    for crowd, most in ((same, limits.of_one), (others, limits.connections)):
        idle = [each for each in crowd if each.idle]
        if len(crowd) >= most:
            if not idle:
                return False
            # A client that proved its name goes last.
            min(idle, key=lambda each: (each.authenticated, each.idle_since)).transport.abort()
    return True


def make_handshake_room(
    handshakes: dict[asyncio.Task[None], str], address: str, limits: HttpLimits, *, connected: int
) -> bool:
    """End the oldest handshake where there are too many; returns whether there is room.

    Args:
        handshakes: Those that are not over, oldest first, each with its source.
        address: The new client's.
        limits: The most of one client, and in all.
        connected: Number of connections whose handshake is over.
    """
    source = source_of(address)
    same = [task for task, other in handshakes.items() if other == source]
    if len(same) >= limits.of_one and not limits.is_proxy(address):
        oldest = same[0]
    elif len(handshakes) + connected < limits.connections + MARGIN:
        return True
    elif handshakes:
        oldest = next(iter(handshakes))
    else:
        return False
    del handshakes[oldest]
    oldest.cancel()
    return True
