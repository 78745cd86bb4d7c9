"""Ports that stay free for who is to listen on them."""

from __future__ import annotations

import socket
import subprocess
import sys

import pytest

from eskin.demo.ports import LOOPBACK, free_ports


def test_ports_are_different_and_free() -> None:
    ports = free_ports(20)
    assert len(set(ports)) == 20
    for port in ports:
        socket.create_server((LOOPBACK, port)).close()


@pytest.mark.skipif(sys.platform != "linux", reason="other systems cannot reserve a port")
def test_no_other_process_is_given_them() -> None:
    mine = free_ports(20)
    script = "from eskin.demo.ports import free_ports; print(*free_ports(12_000))"
    found = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True
    )
    others = {int(port) for port in found.stdout.split()}
    assert len(others) > 5_000
    assert not others & set(mine)
    for _ in range(2):  # a server that comes back
        for port in mine:
            with socket.create_server((LOOPBACK, port)):
                assert port not in free_ports(100)


def test_port_that_is_held_is_not_given() -> None:
    (port,) = free_ports(1)
    with socket.create_server((LOOPBACK, port)):
        assert port not in free_ports(11_000)


def test_no_outgoing_connection_is_given_one() -> None:
    ports = set(free_ports(11_000))
    with socket.create_server((LOOPBACK, 0)) as server:
        for _ in range(100):
            with socket.create_connection(server.getsockname()) as outgoing:
                assert outgoing.getsockname()[1] not in ports
