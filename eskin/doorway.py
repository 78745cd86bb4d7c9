"""A listening socket that bounds connections before their TLS handshake is over.

A server learns of a connection after it. A client that never begins one would hold as many sockets
as the process may open.
"""

from __future__ import annotations

import asyncio
import os
import socket
from typing import TYPE_CHECKING, Any, Final

from eskin.errors import SettingsError
from eskin.limiting import source_of

if TYPE_CHECKING:
    from eskin.listening import Bounds

_MARGIN: Final = 32
"""So many more may come as far as the protocol, which ends an idle one for each, or refuses."""
_REFUSED_AT_ONCE: Final = 64
"""Then the others have a turn."""


class Doorway(socket.socket):
    """Accepts connections, and bounds how many have not ended their TLS handshake.

    Where there are too many of one address, or in all, the one that began first is ended: a client
    that means it takes a moment only. How many may be open after that the protocol decides.

    Only with asyncio's own event loop: uvloop accepts by itself, and asks nobody.

    Args:
        bound: Bound and listening; it is taken over.
        bounds: How many there may be, and how long a handshake may take (``head_s``).

    Attributes:
        inside: Connections that are open.
    """

    def __init__(self, bound: socket.socket, bounds: Bounds) -> None:
        super().__init__(bound.family, bound.type, bound.proto, fileno=bound.detach())
        self._bounds = bounds
        self._shaking: dict[int, tuple[_Guest, asyncio.TimerHandle]] = {}
        self._ended: set[int] = set()
        self.inside = 0

    def accept(self) -> tuple[socket.socket, Any]:
        """Let the next one in for whom there is room; called by the event loop.

        Raises:
            BlockingIOError: Nobody waits, or the others shall have a turn.
        """
        for _ in range(_REFUSED_AT_ONCE):
            if len(self._ended) >= _REFUSED_AT_ONCE:
                break  # until the event loop has closed them
            arrived, address = super().accept()
            host = source_of(address[0])
            shaking = [guest for guest, _ in self._shaking.values()]
            same = (
                [] if self._bounds.is_proxy(address[0]) else [g for g in shaking if g.host == host]
            )
            if len(same) >= self._bounds.of_one:
                self._end(same[0])
            elif self.inside - len(self._ended) >= self._bounds.connections + _MARGIN:
                if not shaking:
                    arrived.close()
                    continue
                self._end(shaking[0])
            return self._let_in(arrived, host), address
        raise BlockingIOError

    def greet(self, number: int) -> None:
        """Know that a connection's handshake is over.

        Args:
            number: Its file descriptor.
        """
        waiting = self._shaking.pop(number, None)
        if waiting is not None:
            waiting[1].cancel()

    def leave(self, number: int) -> None:
        """Know that a connection is closed."""
        self.greet(number)
        self._ended.discard(number)
        self.inside -= 1

    def _end(self, guest: _Guest) -> None:
        self.greet(guest.number)
        self._ended.add(guest.number)
        guest.put_out()

    def _let_in(self, arrived: socket.socket, host: str) -> socket.socket:
        guest = _Guest(arrived, self, host)
        self.inside += 1
        later = asyncio.get_running_loop().call_later
        self._shaking[guest.number] = guest, later(self._bounds.head_s, guest.put_out)
        return guest


class _Guest(socket.socket):
    def __init__(self, arrived: socket.socket, doorway: Doorway, host: str) -> None:
        super().__init__(arrived.family, arrived.type, arrived.proto, fileno=arrived.detach())
        self.number: Final = self.fileno()
        self._doorway: Doorway | None = doorway
        self.host = host

    def put_out(self) -> None:
        """End it: its handshake took too long. The event loop closes it then."""
        try:
            self.shutdown(socket.SHUT_RDWR)
        except OSError:
            return  # the peer was quicker

    def close(self) -> None:
        """Close it, and make room."""
        super().close()
        doorway, self._doorway = self._doorway, None
        if doorway is not None:
            doorway.leave(self.number)


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
