"""Free ports on loopback."""

from __future__ import annotations

import socket
from random import SystemRandom
from typing import Final

from eskin.errors import SettingsError

LOOPBACK: Final = "127.0.0.1"
_PORTS: Final = range(20_000, 32_000)
"""Below those of outgoing connections: from 32768 on Linux, from 49152 elsewhere (RFC 6335)."""


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
    not come back to it.
    """
    found: list[int] = []
    for port in SystemRandom().sample(_PORTS, len(_PORTS)):
        if len(found) == count:
            break
        if _is_free(port):
            found.append(port)
    return found


def _is_free(port: int) -> bool:
    with socket.socket() as probe:
        try:
            probe.bind((LOOPBACK, port))
        except OSError:
            return False
        return True


def accepts(port: int) -> bool:
    """Whether a process listens on a port."""
    with socket.socket() as probe:
        probe.settimeout(1.0)
        return probe.connect_ex((LOOPBACK, port)) == 0
