"""Judging a caller again before each piece of an answer: a revocation counts in open requests."""

from __future__ import annotations

import asyncio
import time
from typing import TYPE_CHECKING, Final

from starlette.requests import Request

from cloud.problems import refuse
from eskin.errors import EskinError

if TYPE_CHECKING:
    from collections.abc import Callable

    from starlette.types import ASGIApp, Message, Receive, Scope, Send

_KEY: Final = "eskin.checks"
_FRESH_S: Final = 1.0
"""For so long one judgement of a caller is good."""
_PIECE: Final = 65_536
"""Bytes of a body that go out after one judgement, and in one deadline of the connection."""


def recheck(request: Request, check: Callable[[], object]) -> None:
    """Have a caller judged again before each piece of the answer.

    Args:
        request: The caller's.
        check: Raises `EskinError` once the caller may not have the answer any more.
    """
    request.scope.setdefault(_KEY, []).append(check)


class RecheckMiddleware:
    """Sends long bodies in pieces, and asks the checks of a request between them.

    An answer that has not begun is replaced by the refusal; one that has is broken off.

    Args:
        app: The application inside.
    """

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        checks: list[Callable[[], object]] = scope.setdefault(_KEY, [])
        judged = time.monotonic()  # at the earliest
        replaced = False

        async def judge() -> None:
            nonlocal judged
            if checks and time.monotonic() >= judged + _FRESH_S:
                await asyncio.to_thread(_ask, checks)
                judged = time.monotonic()

        async def sending(message: Message) -> None:
            nonlocal replaced
            if message["type"] == "http.response.start":
                try:
                    await judge()
                except EskinError as error:
                    replaced = True
                    await refuse(Request(scope), error)(scope, receive, send)
                    raise
                await send(message)
                return
            body, more = message.get("body", b""), message.get("more_body", False)
            for at in range(0, max(1, len(body)), _PIECE):
                await judge()
                last = at + _PIECE >= len(body)
                piece = body if len(body) <= _PIECE else body[at : at + _PIECE]
                await send({**message, "body": piece, "more_body": more or not last})

        try:
            await self._app(scope, receive, sending)
        except Exception:  # which ended the application, once its answer was replaced
            if not replaced:
                raise


def _ask(checks: list[Callable[[], object]]) -> None:
    for check in checks:
        check()
