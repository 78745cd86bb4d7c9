"""A TLS socket that reads and writes in large pieces.

paho reads a packet's first byte, its length byte by byte and its rest, and writes each packet
alone. Each of these would be a call of OpenSSL, which releases Python's lock. With paho's own
socket, thread and packets a message costs the gateway 1.07 to 1.27 times as much CPU
(``python -m benchmarks.gateway_lanes``).
"""

from __future__ import annotations

import ssl
from contextlib import suppress
from typing import Any, Final

from eskin.identity.tls import ClosingSocket

_RECORD: Final = 16_384
"""Bytes of one call: the most of a TLS record (RFC 8446, section 5.1)."""
_CONGESTED: Final = 1_048_576


class BufferedSocket(ClosingSocket):
    """Reads record by record; what is sent waits for `flush`.

    A context with this ``sslsocket_class`` makes it. Not thread-safe.
    """

    _input = b""
    _at = 0
    _output: bytearray | None = None
    drained = False
    """Whether the last `recv` found nothing."""

    def recv(self, buflen: int = 1024, flags: int = 0) -> bytes:
        """Return at most ``buflen`` bytes, as ``SSLSocket.recv`` does."""
        if self._at == len(self._input):
            self._input, self._at = self._receive(flags), 0
        start = self._at
        self._at = min(start + buflen, len(self._input))
        return self._input[start : self._at]

    def _receive(self, flags: int) -> bytes:
        self.drained = True
        data = super().recv(_RECORD, flags)
        self.drained = False
        return data

    def send(self, data: Any, flags: int = 0) -> int:
        """Take all of ``data``; the next `flush` writes it."""
        del flags
        if self._output is None:
            self._output = bytearray()
        self._output += data
        return len(data)

    def flush(self) -> None:
        """Write what was sent, as far as the network takes it now.

        Raises:
            OSError: The connection ended.
        """
        while self._output:
            try:
                # After a short write, OpenSSL wants the same bytes first.
                sent = super().send(bytes(self._output[:_RECORD]))
            except (ssl.SSLWantReadError, ssl.SSLWantWriteError):
                return
            del self._output[:sent]

    def close(self) -> None:
        """Flush what can be written, and close."""
        with suppress(OSError):
            self.flush()
        super().close()

    @property
    def unsent(self) -> int:
        """Bytes that wait for `flush`."""
        return len(self._output or b"")

    @property
    def congested(self) -> bool:
        """Whether the peer reads too slowly to take more."""
        return self.unsent > _CONGESTED
