"""Answers that break off when they have begun: the connection is closed, and the log has a line."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING

from eskin.errors import EskinError

if TYPE_CHECKING:
    from starlette.types import ASGIApp, Message, Receive, Scope, Send

log = logging.getLogger(__name__)


class BrokenOffMiddleware:
    """Ends an answer that can be no refusal any more, so that its reader sees that it is not whole.

    A token is revoked, or the store fails, in the midst of an export: that is foreseen, and no
    fault of the program that its log should tell with a traceback.

    Args:
        app: The application inside.
    """

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on."""
        begun = False

        async def sending(message: Message) -> None:
            nonlocal begun
            begun = begun or message["type"] == "http.response.start"
            await send(message)

        try:
            await self._app(scope, receive, sending)
        except Exception as error:
            # Starlette raises another error from one for which its refusal comes too late.
            reason = error if isinstance(error, EskinError) else error.__cause__
            if not begun or not isinstance(reason, EskinError):
                raise
            # The server closes a connection whose answer did not end.
            log.warning("answer broken off: path=%r reason=%s", scope["path"], reason)
