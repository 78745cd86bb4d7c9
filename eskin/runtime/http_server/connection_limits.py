"""Limit the open connections of a listener: of one client, and in all."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from eskin.runtime.http_server.rate_limit import source_of

if TYPE_CHECKING:
    import asyncio
    from collections.abc import Iterable

    from eskin.runtime.http_server.counted_connection import CountedConnection
    from eskin.runtime.http_server.protocol import HttpLimits

MARGIN: Final = 32
"""So many connections above the limit reach the protocol, which ends an idle one for each."""


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
