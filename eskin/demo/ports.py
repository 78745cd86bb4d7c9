"""Free ports on loopback."""

from __future__ import annotations

import os
import socket
import sys
from collections import deque
from random import SystemRandom
from typing import Final

from eskin.errors import SettingsError

LOOPBACK: Final = "127.0.0.1"
_PORTS: Final = range(20_000, 32_000)
"""Below those of outgoing connections: from 32768 on Linux, from 49152 elsewhere (RFC 6335)."""
_RESERVED: Final = 64
_reserved: Final[deque[int]] = deque()
"""Descriptors of the sockets that are bound to the ports given last; they end with the process."""


def require_free(port: int) -> int:
    """Check that a port is free.

    Raises:
        SettingsError: It is not.
    """
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((LOOPBACK, port))
        except OSError as error:
            raise SettingsError(
                "--port", f"{port} cannot be used: {error.strerror}; choose another with --port"
            ) from error
    return port


def free_ports(count: int) -> list[int]:
    """So many ports, all different, that are free now and that no outgoing connection is given.

    While a service is down, another connection could hold its port, and the service could
    not come back to it. On Linux no other process is given the last 64 of them, either, while
    this one runs: two demos that start together listen on different ports.
    """
    found: list[int] = []
    for port in SystemRandom().sample(_PORTS, len(_PORTS)):
        if len(found) == count:
            break
        if _reserve(port):
            found.append(port)
    return found


def _reserve(port: int) -> bool:
    with socket.socket() as probe:
        try:
            probe.bind((LOOPBACK, port))
        except OSError:
            return False
        if sys.platform == "linux":
            # Servers set this option, and may listen beside a socket that has it and does not
            # listen (socket(7)); a probe like this one does not, and is refused.
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            if len(_reserved) == _RESERVED:
                os.close(_reserved.popleft())
            _reserved.append(probe.detach())
        return True


def accepts(port: int) -> bool:
    """Whether a process listens on a port."""
    with socket.socket() as probe:
        probe.settimeout(1.0)
        return probe.connect_ex((LOOPBACK, port)) == 0
