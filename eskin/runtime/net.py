"""Sockets and addresses."""

from __future__ import annotations

import socket
from ipaddress import ip_address
from typing import Any


def is_loopback(host: str) -> bool:
    """Whether an address, or the name localhost, stays on this machine."""
    if host == "localhost":
        return True
    try:
        return ip_address(host).is_loopback
    except ValueError:
        return False


def set_nodelay(_client: object, _userdata: Any, own: Any) -> None:
    """Disable Nagle's algorithm; paho's ``on_socket_open``.

    Without it, a packet waits for the acknowledgement of the one before (RFC 896), which the peer
    delays by 40 ms (RFC 1122, section 4.2.3.2).
    """
    own.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
