"""Asking an application without a socket, as directly as can be."""

from __future__ import annotations

import asyncio
from threading import Thread
from typing import TYPE_CHECKING

from tests.support.asgi import Answer, ask

if TYPE_CHECKING:
    from starlette.types import ASGIApp


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
        answer = ask(self._app, method, target, headers, body)
        return asyncio.run_coroutine_threadsafe(answer, self._loop).result()
