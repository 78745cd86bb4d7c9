"""The buffered TLS socket gives the same bytes as a plain one, in pieces of any size."""

from __future__ import annotations

import socket
import ssl
from contextlib import contextmanager
from threading import Thread
from typing import TYPE_CHECKING

import pytest
from eskin_gateway.mqtt.buffered_socket import BufferedSocket

from eskin.identity import IdentityKind, client_context, server_context
from eskin.identity.identity import ROOT_FILE
from tests.support.processes import wait_until

if TYPE_CHECKING:
    from collections.abc import Iterator

    from tests.support.identities import Identities


@contextmanager
def connected(identities: Identities) -> Iterator[tuple[BufferedSocket, ssl.SSLSocket]]:
    """A buffered client that does not block, and a plain server that does."""
    identity = identities.make(IdentityKind.SERVER, "server.buffered")
    server = server_context(identity.directory, client_certificates=False)
    client = client_context(identity.directory / ROOT_FILE)
    client.sslsocket_class = BufferedSocket
    near, far = socket.socketpair()
    accepted: list[ssl.SSLSocket] = []
    thread = Thread(target=lambda: accepted.append(server.wrap_socket(far, server_side=True)))
    thread.start()
    own = client.wrap_socket(near, server_hostname="localhost")
    thread.join()
    assert isinstance(own, BufferedSocket)
    own.settimeout(0.0)
    with own, accepted[0] as peer:
        peer.settimeout(60.0)
        yield own, peer


def received(own: BufferedSocket, size: int, piece: int) -> bytes:
    found = b""

    def more() -> bool:
        nonlocal found
        try:
            while len(found) < size:
                found += own.recv(min(piece, size - len(found)))
        except ssl.SSLWantReadError:
            assert own.drained
        return len(found) == size

    wait_until(more, f"{size} bytes came")
    return found


@pytest.mark.parametrize("piece", [7, 50_000])
def test_records_are_read_whole_in_pieces_of_any_size(identities: Identities, piece: int) -> None:
    data = bytes(range(256)) * 5
    with connected(identities) as (own, peer):
        for start in range(0, len(data), 160):
            peer.sendall(data[start : start + 160])
        assert received(own, len(data), piece) == data
        assert not own.drained
        with pytest.raises(ssl.SSLWantReadError):
            own.recv(1)
        assert own.drained


def test_end_of_the_connection_is_an_empty_read(identities: Identities) -> None:
    with connected(identities) as (own, peer):
        peer.shutdown(socket.SHUT_RDWR)
        wait_until(lambda: _ended(own), "the end came")


def _ended(own: BufferedSocket) -> bool:
    try:
        return own.recv(1) == b""
    except ssl.SSLWantReadError:
        return False
    except OSError:
        return True


def test_what_is_sent_waits_for_flush_and_for_a_slow_reader(identities: Identities) -> None:
    data = bytes(range(256)) * 12_000
    with connected(identities) as (own, peer):
        for start in range(0, len(data), 1000):
            assert own.send(data[start : start + 1000]) == len(data[start : start + 1000])
        assert own.unsent == len(data)
        assert own.congested
        own.flush()
        assert 0 < own.unsent < len(data), "the peer reads nothing yet"
        found = bytearray()
        while len(found) < len(data):
            found += peer.recv(65_536)
            own.flush()
        assert found == data
        assert not own.congested


def test_closing_sends_what_waits(identities: Identities) -> None:
    with connected(identities) as (own, peer):
        own.send(b"goodbye")
        own.close()
        assert peer.recv(100) == b"goodbye"
