"""Judging a request again before each piece of its answer: revocation and erasure count at once."""

from __future__ import annotations

import asyncio
import time
from typing import TYPE_CHECKING, Final, NamedTuple

from starlette.requests import Request

from cloud.problems import refuse
from eskin.errors import EskinError
from eskin.listening import PROMPT

if TYPE_CHECKING:
    from collections.abc import Callable, Collection

    from starlette.types import ASGIApp, Message, Receive, Scope, Send

_KEY: Final = "eskin.checks"
_FRESH_S: Final = 1.0
"""For so long one judgement of a caller is good."""
_PIECE: Final = 65_536
"""Bytes of a body that go out after one judgement, and in one deadline of the connection."""
_PROMPT_PIECE: Final = 16_384
"""The same where a judgement is good for one piece only."""


class _Check(NamedTuple):
    ask: Callable[[], object]
    each_piece_with: Collection[object] | None


def recheck(
    request: Request,
    check: Callable[[], object],
    *,
    each_piece_with: Collection[object] | None = None,
) -> None:
    """Have a request judged again before each piece of the answer.

    Args:
        request: The caller's.
        check: Raises `EskinError` once the caller may not have the answer any more.
        each_piece_with: Once something is in it, the check is asked before every piece, and no
            buffer holds more than a piece. ``None``: the check is good for a second.
    """
    request.scope.setdefault(_KEY, []).append(_Check(check, each_piece_with))


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
        answer = _Answer(scope, receive, send)
        try:
            await self._app(scope, receive, answer.send)
        except Exception:  # which ended the application, once its answer was replaced
            if not answer.replaced:
                raise


class _Answer:
    """One answer, judged before it begins and before each piece.

    Attributes:
        replaced: Whether the refusal was sent in its place.
    """

    def __init__(self, scope: Scope, receive: Receive, send: Send) -> None:
        self._scope = scope
        self._receive = receive
        self._send = send
        self._checks: list[_Check] = scope.setdefault(_KEY, [])
        self._judged = time.monotonic()  # at the earliest
        self._piece = _PIECE
        self.replaced = False

    async def send(self, message: Message) -> None:
        """Send a message of the application, in pieces."""
        if message["type"] == "http.response.start":
            await self._begin(message)
            return
        if self._piece == _PIECE and any(check.each_piece_with for check in self._checks):
            self._piece = _PROMPT_PIECE
            if prompt := self._scope.get("extensions", {}).get(PROMPT):
                prompt["begin"]()  # else buffers hold megabytes that no check can call back
        body, more = message.get("body", b""), message.get("more_body", False)
        for at in range(0, max(1, len(body)), self._piece):
            await self._judge()
            last = at + self._piece >= len(body)
            piece = body if len(body) <= self._piece else body[at : at + self._piece]
            await self._send({**message, "body": piece, "more_body": more or not last})

    async def _begin(self, message: Message) -> None:
        try:
            await self._judge()
        except EskinError as error:
            self.replaced = True
            await refuse(Request(self._scope), error)(self._scope, self._receive, self._send)
            raise
        await self._send(message)

    async def _judge(self) -> None:
        fresh = time.monotonic() < self._judged + _FRESH_S
        due = [check for check in self._checks if not fresh or check.each_piece_with]
        if due:
            await asyncio.to_thread(_ask, due)
            self._judged = self._judged if fresh else time.monotonic()


def _ask(checks: list[_Check]) -> None:
    for check in checks:
        check.ask()
