"""Free ports on loopback."""

from __future__ import annotations

import socket

from eskin.errors import SettingsError

LOOPBACK = "127.0.0.1"


def require_free(port: int) -> int:
    """Check that nobody listens on a port.

    Raises:
        SettingsError: Somebody does.
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
    """So many ports, all different, that are free now."""
    probes = [socket.socket() for _ in range(count)]
    try:
        for probe in probes:
            probe.bind((LOOPBACK, 0))
        return [int(probe.getsockname()[1]) for probe in probes]
    finally:
        for probe in probes:
            probe.close()


def accepts(port: int) -> bool:
    """Whether somebody listens on a port."""
    with socket.socket() as probe:
        probe.settimeout(1.0)
        return probe.connect_ex((LOOPBACK, port)) == 0
