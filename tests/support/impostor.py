"""Servers in another's place: with a certificate that is not good for it, or without TLS."""

from __future__ import annotations

import socket
import ssl
import threading
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING, Final, Self

from eskin.identity import IdentityKind
from eskin.identity.identity import CHAIN_FILE, KEY_FILE
from tests.support.identities import Identities

if TYPE_CHECKING:
    from pathlib import Path

    from eskin.identity import Identity

GUISES: Final = {
    "outsider": "certificate verify failed: (unable to get local issuer|self.signed)",
    "other name": "certificate verify failed: IP address mismatch",
    "expired": "certificate verify failed: certificate has expired",
    "plaintext": r"\[SSL",
}
"""By their names, what a party must say of them."""
_WELCOME: Final = b"\x20\x02\x00\x00" + b"\xd0\x00"
"""A broker's CONNACK, which lets everybody in, and PINGRESP (MQTT 3.1.1, sections 3.2 and 3.13)."""
_TURN_S: Final = 0.05
_HANDSHAKE_S: Final = 60.0
"""However slow a visitor is: of a handshake that was cut off, the rest would look like more."""
_PATIENCE_S: Final = 5.0
_PIECE: Final = 65_536


@dataclass(frozen=True, slots=True)
class Visit:
    """One connection.

    Attributes:
        said: What the visitor said in confidence: after the handshake, decrypted.
        after: What came once the handshake had failed; without TLS, all that came.
    """

    said: bytes
    after: bytes


class Impostor:
    """Listens on loopback until the block is left.

    Args:
        port: Whose it takes.
        identity: What it shows; ``None``: it speaks no TLS, and welcomes as a broker does.

    Attributes:
        visits: All that are over.
    """

    def __init__(self, port: int, identity: Identity | None) -> None:
        self._port = port
        self._context = None if identity is None else _showing(identity)
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._serve, name="impostor", daemon=True)
        self.visits: list[Visit] = []

    def __enter__(self) -> Self:
        self._listener = socket.create_server(("127.0.0.1", self._port))
        self._listener.settimeout(_TURN_S)
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ending.set()
        self._thread.join()
        self._listener.close()

    @property
    def confided(self) -> bytes:
        """All that visitors said in confidence."""
        return b"".join(visit.said for visit in self.visits)

    def _serve(self) -> None:
        while not self._ending.is_set():
            with suppress(TimeoutError):
                peer, _ = self._listener.accept()
                with peer:
                    self.visits.append(self._receive(peer))

    def _receive(self, peer: socket.socket) -> Visit:
        peer.settimeout(_PATIENCE_S if self._context is None else _HANDSHAKE_S)
        if self._context is None:
            peer.sendall(_WELCOME)
            return Visit(b"", _rest(peer))
        incoming, outgoing = ssl.MemoryBIO(), ssl.MemoryBIO()
        tls = self._context.wrap_bio(incoming, outgoing, server_side=True)
        said = b""
        try:
            while True:
                try:
                    tls.do_handshake()  # of no effect once it is over
                    peer.settimeout(_PATIENCE_S)
                    piece = tls.read(_PIECE)
                except ssl.SSLWantReadError:
                    _exchange(peer, incoming, outgoing)
                    continue
                if not piece:
                    return Visit(said, _rest(peer))
                said += piece
        except (ssl.SSLError, EOFError):
            return Visit(said, incoming.read() + _rest(peer))


def guise(name: str, identities: Identities, folder: Path) -> Identity | None:
    """What an impostor shows.

    Args:
        name: One of `GUISES`.
        identities: The right CA.
        folder: Takes what a outsider's CA makes.
    """
    if name == "outsider":
        return Identities(folder / "outsiders").make(IdentityKind.SERVER, "server.broker")
    if name == "other name":
        hosts = ("elsewhere.example",)
        return identities.make(IdentityKind.SERVER, "server.elsewhere", hosts=hosts)
    if name == "expired":
        begin, day = datetime.now(UTC) - timedelta(days=2), timedelta(days=1)
        return identities.make(IdentityKind.SERVER, "server.old", now=begin, lifetime=day)
    return None


def _showing(identity: Identity) -> ssl.SSLContext:
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.load_cert_chain(identity.directory / CHAIN_FILE, identity.directory / KEY_FILE)
    return context


def _exchange(peer: socket.socket, incoming: ssl.MemoryBIO, outgoing: ssl.MemoryBIO) -> None:
    """Pass on what TLS has to say, and what comes.

    Raises:
        EOFError: The visitor left.
    """
    with suppress(OSError):
        peer.sendall(outgoing.read())
    try:
        piece = peer.recv(_PIECE)
    except OSError:
        piece = b""
    if not piece:
        raise EOFError
    incoming.write(piece)


def _rest(peer: socket.socket) -> bytes:
    """All that still comes until the visitor leaves."""
    found = b""
    with suppress(OSError):
        while piece := peer.recv(_PIECE):
            found += piece
    return found


def is_tls(data: bytes) -> bool:
    """Whether bytes are handshake and alert records alone (RFC 8446, section 5.1)."""
    while data:
        if data[0] not in {21, 22} or data[1] != 3:
            return False
        data = data[5 + int.from_bytes(data[3:5]) :]
    return True
