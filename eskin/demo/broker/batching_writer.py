"""Packets of one turn of the event loop leave together."""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING

from amqtt.adapters import StreamWriterAdapter

if TYPE_CHECKING:
    from asyncio import StreamWriter


class BatchingWriter(StreamWriterAdapter):  # type: ignore[misc]  # amqtt ships no types
    """Writes what came up in one turn of the event loop as one TLS record, by one system call.

    amqtt writes each packet by itself; with many small ones, that is a third of what a broker does.

    Args:
        writer: Of the connection.
    """

    def __init__(self, writer: StreamWriter) -> None:
        super().__init__(writer)
        self._loop = asyncio.get_running_loop()
        self._held: list[bytes | bytearray] = []

    def write(self, data: bytes | bytearray) -> None:
        """Write some bytes, with all others that come up in this turn."""
        if self.is_closed:
            return
        if not self._held:
            self._loop.call_soon(self._flush)
        self._held.append(data)

    async def close(self) -> None:
        """Write what is held, and close."""
        self._flush()
        await super().close()

    def _flush(self) -> None:
        held, self._held = self._held, []
        if held and not self.is_closed:
            self._writer.write(b"".join(held))
