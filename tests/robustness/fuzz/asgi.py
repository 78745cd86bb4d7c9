"""Asking an application without a socket, as directly as can be."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass
from threading import Thread
from typing import TYPE_CHECKING, Any
from urllib.parse import unquote_to_bytes

if TYPE_CHECKING:
    from starlette.types import ASGIApp, Message


@dataclass(frozen=True, slots=True)
class Answer:
    """An answer, whole."""

    status: int
    headers: dict[bytes, bytes]
    body: bytes


class Asker:
    """Asks one application, one request after the other.

    As under a server, one task outlives all requests: the application's threads are kept with it.
    """

    def __init__(self, app: ASGIApp) -> None:
        self._app = app
        self._loop = asyncio.new_event_loop()
        self._ended = asyncio.Event()
        serve = self._loop.run_until_complete
        # It does not outlive a process that an input broke.
        self._thread = Thread(target=serve, args=(self._ended.wait(),), daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End its loop."""
        self._loop.call_soon_threadsafe(self._ended.set)
        self._thread.join()
        self._loop.close()

    def ask(
        self, method: str, target: bytes, headers: list[tuple[bytes, bytes]], body: bytes
    ) -> Answer:
        """Send a request; who asks is gone as soon as it has sent it."""
        path, _, query = target.partition(b"?")
        scope: dict[str, Any] = {
            "type": "http",
            "asgi": {"version": "3.0"},
            "http_version": "1.1",
            "method": method,
            "scheme": "http",
            "path": unquote_to_bytes(path).decode("utf-8", "replace"),
            "raw_path": path,
            "query_string": query,
            "root_path": "",
            "headers": headers,
            "client": ("127.0.0.1", 5000),
            "server": ("127.0.0.1", 8080),
        }
        return asyncio.run_coroutine_threadsafe(self._answer(scope, body), self._loop).result()

    async def _answer(self, scope: dict[str, Any], body: bytes) -> Answer:
        waiting: list[Message] = [{"type": "http.request", "body": body, "more_body": False}]
        sent: list[Message] = []

        async def receive() -> Message:
            return waiting.pop() if waiting else {"type": "http.disconnect"}

        async def send(message: Message) -> None:
            sent.append(message)

        await self._app(scope, receive, send)
        start, *rest = sent
        parts = b"".join(message.get("body", b"") for message in rest)
        return Answer(start["status"], dict(start["headers"]), parts)
