"""A listener: one uvicorn server on a socket of its own, with TLS where it has a certificate."""

from __future__ import annotations

import asyncio
import contextlib
from typing import TYPE_CHECKING, Final

import uvicorn

from eskin.doorway import Doorway
from eskin.listening import guarded

if TYPE_CHECKING:
    import ssl
    from collections.abc import Iterator, Sequence
    from socket import socket

    from starlette.types import ASGIApp

    from eskin.listening import Bounds

_GRACE_SECONDS: Final = 10


class Listener(uvicorn.Server):
    """A server whose signals and whose state are somebody else's.

    Args:
        app: What answers.
        bound: Where it listens; it is taken over.
        context: For TLS; ``None`` for plain HTTP.
        bounds: What a stranger may take.
        headers: Added to each answer of the application.

    Attributes:
        ready: Set once it accepts.
    """

    def __init__(
        self,
        app: ASGIApp,
        bound: socket,
        *,
        context: ssl.SSLContext | None,
        bounds: Bounds,
        headers: Sequence[tuple[str, str]] = (),
    ) -> None:
        doorway = Doorway(bound, bounds)
        config = uvicorn.Config(
            app,
            http=guarded(bounds, greet=doorway.greet),
            ws="none",
            lifespan="off",
            headers=list(headers),
            log_config=None,
            access_log=False,
            proxy_headers=False,
            server_header=False,
            timeout_graceful_shutdown=_GRACE_SECONDS,
        )
        config.load()
        config.ssl = context
        super().__init__(config)
        self._bound = doorway
        self._context = context
        self.ready = asyncio.Event()

    @property
    def url(self) -> str:
        """Where it is reached."""
        host, port = self._bound.getsockname()[:2]
        scheme = "http" if self._context is None else "https"
        return f"{scheme}://{f'[{host}]' if ':' in host else host}:{port}"

    async def run_until_told(self) -> None:
        """Serve until ``should_exit``."""
        await self.serve(sockets=[self._bound])

    async def startup(self, sockets: list[socket] | None = None) -> None:
        """Accept, and say so."""
        await super().startup(sockets)
        self.ready.set()

    @contextlib.contextmanager
    def capture_signals(self) -> Iterator[None]:
        """Leave signals to the process."""
        yield
