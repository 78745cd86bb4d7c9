"""Answers that lack what a damaged row held say so in a header, with the rows' names."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from cloud.store.damage import collected

if TYPE_CHECKING:
    from starlette.types import ASGIApp, Message, Receive, Scope, Send

HEADER: Final = "Eskin-Damaged"
_FEW: Final = 20


class DamagedHeaderMiddleware:
    """Adds ``Eskin-Damaged``: node, boot and sequence of damaged blocks that an answer lacks.

    A list of strings (RFC 9651, section 3.1), at most 20, then ``"..."``. An answer that is sent
    while it is made, as an export, has its header before its rows are read; the log names those.

    Args:
        app: The application inside.
    """

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on, and collect what is met meanwhile."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        with collected() as damaged:

            async def tell(message: Message) -> None:
                if message["type"] == "http.response.start" and damaged:
                    named = [f'"{row}"' for row in damaged[:_FEW]]
                    named += ['"..."'] if len(damaged) > _FEW else []
                    header = HEADER.lower().encode(), ", ".join(named).encode()
                    message["headers"] = [*message["headers"], header]
                await send(message)

            await self._app(scope, receive, tell)
