"""A server on loopback that answers as the cloud does: the dashboard, REST, and live frames."""

from __future__ import annotations

import asyncio
import json
import struct
import threading
import time
from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, Any, Final, NamedTuple, Self

import uvicorn
from eskin_cloud.schemas.frames import describe_layout
from eskin_cloud.service import DASHBOARD
from starlette.applications import Starlette
from starlette.responses import JSONResponse, Response
from starlette.routing import Mount, Route, WebSocketRoute
from starlette.staticfiles import StaticFiles
from starlette.websockets import WebSocketDisconnect

from eskin.wire.messages.cbor_map import dump
from tests.support.processes import free_port, wait_until

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from starlette.requests import Request
    from starlette.routing import BaseRoute
    from starlette.websockets import WebSocket

    from eskin.wire.frames import DescribedLayout, Frame

_CSP: Final = {"Content-Security-Policy": "default-src 'self'"}
_TRY_LATER: Final = 1013
"""Code with which a WebSocket is closed."""


class LiveMessage(NamedTuple):
    """Something that became known in a stretch.

    Attributes:
        kind: ``frame``, ``event`` or ``contacts``.
        node: Whose it is.
        items: What the message has after its cursor.
    """

    kind: str
    node: str
    items: list[str | int | bytes | None]


class FrameServer(ABC):
    """The server, which sends in each stretch of time what became known in it.

    Args:
        stretch_ns: Length of a stretch.
        layouts: What the frames of each node are read by.
        port: Where to listen; some free one by default.

    Attributes:
        url: Where it listens.
        stretch_ns: Length of a stretch.
        layouts: What the frames of each node are read by.
    """

    def __init__(
        self, stretch_ns: int, layouts: dict[str, DescribedLayout], port: int | None = None
    ) -> None:
        self.stretch_ns = stretch_ns
        self.layouts = layouts
        port = port or free_port()
        self.url = f"http://127.0.0.1:{port}"
        config = uvicorn.Config(
            self._application(), port=port, log_level="warning", timeout_graceful_shutdown=1
        )
        self.server = uvicorn.Server(config)
        self._thread = threading.Thread(target=self.server.run)

    def __enter__(self) -> Self:
        self._thread.start()
        wait_until(lambda: self.server.started, "the server listens")
        return self

    def __exit__(self, *_: object) -> None:
        self.server.should_exit = True
        self._thread.join()

    @property
    def end(self) -> int:
        """Up to this instant (ns) everything is stored."""
        return time.time_ns() // self.stretch_ns * self.stretch_ns

    @abstractmethod
    def routes(self) -> Sequence[BaseRoute]:
        """Routes of the REST API besides layouts and the live stream."""

    def controls(self) -> Sequence[BaseRoute]:
        """Routes that no cloud has."""
        return ()

    @abstractmethod
    def messages_of(self, number: int) -> Iterable[LiveMessage]:
        """What became known in a stretch, counted from 1970."""

    @property
    def refuses(self) -> bool:
        """Whether the live stream is refused."""
        return False

    @property
    def delay_ns(self) -> int:
        """How much later than its end a stretch is sent."""
        return 0

    def skipped_before(self, number: int) -> int | None:  # noqa: ARG002 -- for those that skip
        """How many frames were left out before a stretch; ``None`` where it is not known."""
        return 0

    def following(self, number: int) -> int:
        """The stretch that is sent after another one."""
        return number + 1

    def _application(self) -> Starlette:
        api = [
            *self.routes(),
            Route("/alarms", lambda _: page_of([])),
            Route("/monitors", lambda _: page_of([])),
            Route("/nodes/{node}/gestures", lambda _: page_of([])),
            Route("/nodes/{node}/monitors", lambda _: page_of([])),
            Route("/nodes/{node}/layout", self._layout),
            Route("/nodes/{node}/layouts/{hash}", self._layout),
            WebSocketRoute("/live", self._live),
        ]
        return Starlette(
            routes=[
                *self.controls(),
                Mount("/api/v1", routes=api),
                Mount("/", _Files(directory=DASHBOARD, html=True)),
            ]
        )

    def _layout(self, request: Request) -> Response:
        node = request.path_params["node"]
        return JSONResponse(describe_layout(node, self.layouts[node]))

    async def _live(self, socket: WebSocket) -> None:
        if self.refuses:
            await socket.close(_TRY_LATER)
            return
        await socket.accept()
        cursor = socket.query_params.get("cursor")
        stream = _Stream(self, socket)
        listening = asyncio.create_task(stream.listen())
        number = int(cursor) + 1 if cursor else self.end // self.stretch_ns
        try:
            while not listening.done() and not self.refuses:
                await stream.send(number)
                number = self.following(number)
        except WebSocketDisconnect:
            return
        finally:
            listening.cancel()
        await socket.close(_TRY_LATER)


class _Stream:
    """One live stream, of the nodes that its client asks for."""

    def __init__(self, server: FrameServer, socket: WebSocket) -> None:
        self._server = server
        self._socket = socket
        self._nodes = set(socket.query_params.getlist("node")) or set(server.layouts)
        self._described: set[str] = set()

    async def listen(self) -> None:
        """Take what the client selects, until it leaves."""
        try:
            while True:
                nodes = json.loads(await self._socket.receive_text())["nodes"]
                self._nodes = set(self._server.layouts if nodes is None else nodes)
        except WebSocketDisconnect:
            return

    async def send(self, number: int) -> None:
        """Send a stretch when it is due."""
        server, cursor = self._server, str(number)
        due = (number + 1) * server.stretch_ns + server.delay_ns
        await asyncio.sleep(max(0.0, (due - time.time_ns()) * 1e-9))
        if (skipped := server.skipped_before(number)) != 0:
            await self._send(["lagging", cursor, skipped])
        for kind, node, items in server.messages_of(number):
            if node not in self._nodes:
                continue
            if kind == "frame" and node not in self._described:
                self._described.add(node)
                await self._send(["layout", node, server.layouts[node].hash])
            await self._send([kind, cursor, *items])

    async def _send(self, items: list[str | int | bytes | None]) -> None:
        await self._socket.send_bytes(encode_message(items))


def frame_message(node: str, frame: Frame) -> LiveMessage:
    """A frame that the cloud has received just now."""
    return LiveMessage("frame", node, [node, time.time_ns(), frame.encode()])


def contacts_message(node: str, found: dict[str, Any]) -> LiveMessage:
    """Contacts that were found on the skin of a node."""
    return LiveMessage("contacts", node, [node, json.dumps(found)])


def event_message(event: dict[str, Any]) -> LiveMessage:
    """An event, as REST gives it."""
    return LiveMessage("event", event["node"], [event["kind"], json.dumps(event)])


def encode_message(items: list[str | int | bytes | None]) -> bytes:
    """An array of CBOR."""
    head = b""
    for one in items:
        if one is None:
            head += b"\xf6"
        elif isinstance(one, int):
            head += dump({0: one})[2:]
        else:
            data = one.encode() if isinstance(one, str) else one
            major = 0x60 if isinstance(one, str) else 0x40
            head += bytes([major | 26]) + struct.pack(">I", len(data)) + data
    return bytes([0x80 | len(items)]) + head


def page_of(items: list[Any], following: int | None = None) -> Response:
    """A page of a list, as REST gives it."""
    return JSONResponse({"items": items, "next": None if following is None else str(following)})


class _Files(StaticFiles):
    """The built dashboard, under the cloud's policy."""

    async def get_response(self, path: str, scope: Any) -> Response:
        answer = await super().get_response(path, scope)
        answer.headers.update(_CSP)
        return answer
