"""A TLS socket that reads and writes in large pieces, for a client that asks for single bytes.

paho reads a packet's first byte, its length byte by byte, and its rest; and it writes each packet
alone. Each of these would be a call of OpenSSL, which gives up Python's lock to another thread.
"""

from __future__ import annotations

import ssl
from contextlib import suppress
from typing import Any, Final

from eskin.identity.tls import ClosingSocket

_PIECE: Final = 16_384
"""Bytes of one call: a TLS record holds no more (RFC 8446, section 5.1)."""
_CLOGGED: Final = 1_048_576


class BufferedSocket(ClosingSocket):
    """What arrives is read record by record; what leaves waits for `flush`.

    Made by a context whose ``sslsocket_class`` it is. Not for several threads at once.
    """

    _arrived = b""
    _at = 0
    _leaving: bytearray | None = None
    drained = False
    """Whether the last `recv` found nothing."""

    def recv(self, buflen: int = 1024, flags: int = 0) -> bytes:
        """Give at most ``buflen`` bytes, as ``SSLSocket.recv`` does."""
        if self._at == len(self._arrived):
            self._arrived, self._at = self._receive(flags), 0
        start = self._at
        self._at = min(start + buflen, len(self._arrived))
        return self._arrived[start : self._at]

    def fill(self) -> bool:
        """Have at least one byte at hand; ``False`` where none came.

        Raises:
            OSError: The connection ended.
        """
        if self._at == len(self._arrived):
            try:
                self._arrived, self._at = self._receive(0), 0
            except (ssl.SSLWantReadError, ssl.SSLWantWriteError):
                return False
        return self._at < len(self._arrived)

    def _receive(self, flags: int) -> bytes:
        self.drained = True
        piece = super().recv(_PIECE, flags)
        self.drained = False
        return piece

    @property
    def at_hand(self) -> tuple[bytes, int]:
        """Bytes that arrived, and from where on nobody read them."""
        return self._arrived, self._at

    def skip(self, to: int) -> None:
        """Take the bytes at hand for read, up to a place."""
        self._at = to

    def send(self, data: Any, flags: int = 0) -> int:
        """Take all of ``data``; it leaves with the next `flush`."""
        del flags
        if self._leaving is None:
            self._leaving = bytearray()
        self._leaving += data
        return len(data)

    def flush(self) -> None:
        """Write what was taken, as far as the network takes it now.

        Raises:
            OSError: The connection ended.
        """
        while self._leaving:
            try:
                # Of a piece that found no room, OpenSSL wants the same bytes again first.
                sent = super().send(bytes(self._leaving[:_PIECE]))
            except (ssl.SSLWantReadError, ssl.SSLWantWriteError):
                return
            del self._leaving[:sent]

    def close(self) -> None:
        """Write what can still be written, and close."""
        with suppress(OSError):
            self.flush()
        super().close()

    @property
    def unsent(self) -> int:
        """Bytes that wait for `flush`."""
        return len(self._leaving or b"")

    @property
    def clogged(self) -> bool:
        """Whether the peer reads so little that no more should be handed over."""
        return self.unsent > _CLOGGED
