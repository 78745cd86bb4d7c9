"""How an answer is sent: judged again before each piece, naming what it lacks, or broken off."""

from __future__ import annotations

import asyncio
import logging
import time
from typing import TYPE_CHECKING, Final, NamedTuple

from starlette.requests import HTTPConnection, Request

from eskin.errors import EskinError
from eskin.runtime.http_server.protocol import PROMPT
from eskin_cloud.api.problems import PROBLEMS
from eskin_cloud.store.damage import collect_damaged_rows

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Sequence

    from starlette.types import ASGIApp, Message, Receive, Scope, Send

log = logging.getLogger(__name__)

DAMAGED: Final = "Eskin-Damaged"
_FEW: Final = 20
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
    request: HTTPConnection,
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


class AnswerMiddleware:
    """Sends long bodies in pieces, and asks the checks of a request between them.

    An answer that has not begun is replaced by the refusal; one that has is broken off, so that its
    reader sees that it is not whole. That is foreseen, and needs no traceback.

    ``Eskin-Damaged`` names the damaged rows that an answer lacks, by their keys: a list of strings
    (RFC 9651, section 3.1), at most 20, then ``"..."``. An export is sent
    while it is made: its header names what is found damaged when its samples are counted.

    Args:
        app: The application inside.
    """

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on."""
        if scope["type"] == "websocket":
            await self._app(scope, receive, _judging(scope, send))
            return
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        with collect_damaged_rows() as damaged:
            answer = _Answer(scope, receive, send, damaged)
            try:
                await self._app(scope, receive, answer.send)
            except Exception as error:
                if answer.replaced:  # which ended the application
                    return
                # Starlette raises another error from one for which its refusal comes too late.
                reason = error if isinstance(error, EskinError) else error.__cause__
                if not answer.begun or not isinstance(reason, EskinError):
                    raise
                # The server closes a connection whose answer did not end.
                log.warning("answer broken off: path=%r reason=%s", scope["path"], reason)


def _judging(scope: Scope, send: Send) -> Send:
    """Has a WebSocket judged before its messages: the application gets the refusal as an error."""
    judgement = _Judgement(scope)

    async def judged(message: Message) -> None:
        if message["type"] == "websocket.send":
            await judgement.ask()
        await send(message)

    return judged


class _Judgement:
    """The checks of one request.

    Attributes:
        checks: What is asked.
    """

    def __init__(self, scope: Scope) -> None:
        self.checks: list[_Check] = scope.setdefault(_KEY, [])
        self._at = time.monotonic()  # at the earliest

    async def ask(self) -> None:
        """Ask those that are due.

        Raises:
            EskinError: The caller may not have the answer any more.
        """
        fresh = time.monotonic() < self._at + _FRESH_S
        due = [check for check in self.checks if not fresh or check.each_piece_with]
        if due:
            await asyncio.to_thread(_ask, due)
            self._at = self._at if fresh else time.monotonic()


class _Answer:
    """One answer, judged before it begins and before each piece.

    Attributes:
        begun: Whether its head was sent.
        replaced: Whether the refusal was sent in its place.
    """

    def __init__(
        self, scope: Scope, receive: Receive, send: Send, damaged: Sequence[object]
    ) -> None:
        self._scope = scope
        self._receive = receive
        self._send = send
        self._damaged = damaged
        self._judgement = _Judgement(scope)
        self._piece = _PIECE
        self.begun = False
        self.replaced = False

    async def send(self, message: Message) -> None:
        """Send a message of the application, in pieces."""
        if message["type"] == "http.response.start":
            await self._begin(message)
            return
        if self._piece == _PIECE and any(check.each_piece_with for check in self._judgement.checks):
            self._piece = _PROMPT_PIECE
            if prompt := self._scope.get("extensions", {}).get(PROMPT):
                prompt["begin"]()  # else buffers hold megabytes that no check can call back
        body, more = message.get("body", b""), message.get("more_body", False)
        for at in range(0, max(1, len(body)), self._piece):
            await self._judgement.ask()
            last = at + self._piece >= len(body)
            piece = body if len(body) <= self._piece else body[at : at + self._piece]
            await self._send({**message, "body": piece, "more_body": more or not last})

    async def _begin(self, message: Message) -> None:
        try:
            await self._judgement.ask()
        except EskinError as error:
            self.replaced = True
            refusal = PROBLEMS.refuse(Request(self._scope), error)
            await refusal(self._scope, self._receive, self._send)
            raise
        if self._damaged:
            named = [f'"{_printable(row)}"' for row in self._damaged[:_FEW]]
            named += ['"..."'] if len(self._damaged) > _FEW else []
            header = DAMAGED.lower().encode(), ", ".join(named).encode()
            message["headers"] = [*message["headers"], header]
        self.begun = True
        await self._send(message)


def _ask(checks: list[_Check]) -> None:
    for check in checks:
        check.ask()


def _printable(row: object) -> str:
    """A row's place, whatever its damaged name has become."""
    return "".join(
        letter if letter.isascii() and letter.isprintable() and letter not in '"\\' else "?"
        for letter in str(row)
    )
