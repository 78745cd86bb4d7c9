"""Answers that hold what was opened of a person end once the person is erased."""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING, Final

from eskin.listening import PROMPT

if TYPE_CHECKING:
    from starlette.types import ASGIApp, Message, Receive, Scope, Send

    from cloud.state import Cloud

OPENED: Final = "eskin.opened"
"""Where a request's scope keeps the subjects whose messages were opened for it."""
_PIECE: Final = 16_384


class ErasureGuardMiddleware:
    """Sends what was opened in small pieces, and looks for erasures before each.

    It covers every route: whoever opens a sealed message for a request notes its subject in the
    request's scope (`cloud.privacy.keyholder.Reader`).

    Args:
        app: The application inside.
        cloud: The state.
    """

    def __init__(self, app: ASGIApp, *, cloud: Cloud) -> None:
        self._app = app
        self._cloud = cloud

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on."""
        opened: set[tuple[str, str]] = set()
        scope[OPENED] = opened
        slow = False

        async def sending(message: Message) -> None:
            nonlocal slow
            if not opened or message["type"] != "http.response.body":
                await send(message)
                return
            if not slow and (prompt := scope.get("extensions", {}).get(PROMPT)):
                prompt["begin"]()  # else buffers hold megabytes that no check can call back
                slow = True
            body, more = message.get("body", b""), message.get("more_body", False)
            for begin in range(0, max(1, len(body)), _PIECE):
                await asyncio.to_thread(self._require_unerased, tuple(opened))
                piece = body[begin : begin + _PIECE]
                rest = more or begin + _PIECE < len(body)
                await send({"type": "http.response.body", "body": piece, "more_body": rest})

        await self._app(scope, receive, sending)

    def _require_unerased(self, subjects: tuple[tuple[str, str], ...]) -> None:
        with self._cloud.store.read() as connection:
            self._cloud.keyholder.require_unerased(connection, subjects)
