"""A WebSocket gives a client no more than other connections; with an independent client."""

from __future__ import annotations

import asyncio
import base64
import contextlib
import os
import socket
from typing import TYPE_CHECKING

import pytest
from websockets.asyncio.client import connect
from websockets.exceptions import ConnectionClosed, ConnectionClosedError, InvalidStatus

from eskin.identity import IdentityKind, client_context, server_context
from eskin.runtime.http_server.connection_limits import CALLER
from eskin.runtime.http_server.protocol import LOCALHOST, HttpLimits
from eskin.runtime.http_server.websocket import WINDOW_BYTES
from tests.support.websocket_closing import close_code
from tests.unit.eskin.test_connection_limits import listening, say, status

if TYPE_CHECKING:
    from starlette.types import Message, Receive, Scope, Send

    from tests.support.identities import Identities

pytestmark = pytest.mark.anyio
LIMITS = HttpLimits(message_bytes=4096)
PATIENCE_S = 20.0


@pytest.fixture
def anyio_backend() -> str:
    return "asyncio"


async def echo(scope: Scope, receive: Receive, send: Send) -> None:
    """Answers each message; by HTTP, says how it was asked."""
    if scope["type"] == "http":
        await send({"type": "http.response.start", "status": 200, "headers": []})
        await send({"type": "http.response.body", "body": b"plain"})
        return
    await receive()
    if scope["path"] == "/named":
        scope["extensions"][CALLER]["identify"]("caller")
    await send({"type": "websocket.accept"})
    while (message := await receive())["type"] == "websocket.receive":
        answer = {"type": "websocket.send", "text": None, "bytes": None}
        await send({**answer, **{k: message.get(k) for k in ("text", "bytes")}})


def upgrade(*, method: bytes = b"GET", more: bytes = b"") -> bytes:
    """A request to upgrade."""
    key = base64.b64encode(os.urandom(16))
    return (
        method + b" / HTTP/1.1\r\nHost: here\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
        b"Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: " + key + b"\r\n" + more + b"\r\n"
    )


def client(port: int, path: str = "/", **options: object) -> connect:
    """An independent client."""
    return connect(f"ws://127.0.0.1:{port}{path}", proxy=None, **options)  # type: ignore[arg-type]


async def test_messages_go_both_ways_uncompressed() -> None:
    async with listening(LIMITS, echo) as port, client(port) as connection:
        assert not connection.protocol.extensions
        for message in ("text", b"bytes", "x" * 4096):
            await connection.send(message)
            assert await connection.recv() == message


async def test_messages_go_both_ways_over_tls(identities: Identities) -> None:
    folder = identities.make(IdentityKind.SERVER, "server.cloud").directory
    ours = server_context(folder, client_certificates=False)
    trusting = client_context(folder / "root.pem")
    async with (
        listening(LIMITS, echo, context=ours) as port,
        connect(f"wss://localhost:{port}/", ssl=trusting, proxy=None) as connection,
    ):
        for message in ("text", b"x" * 4096):
            await connection.send(message)
            assert await connection.recv() == message


async def test_long_message_is_refused() -> None:
    async with listening(LIMITS, echo) as port, client(port) as connection:
        await connection.send("x" * 4097)
        assert await close_code(connection) == 1009


async def test_long_message_in_many_fragments_is_refused() -> None:
    async with listening(LIMITS, echo) as port, client(port) as connection:
        with contextlib.suppress(ConnectionClosedError):
            await connection.send("x" for _ in range(4097))
        assert await close_code(connection) in {1008, 1009}


async def test_many_messages_are_refused() -> None:
    async with listening(LIMITS, echo) as port, client(port) as connection:
        with contextlib.suppress(ConnectionClosedError):
            for _ in range(100):
                await connection.send("x")
        assert await close_code(connection) == 1008


async def test_flood_of_pings_is_refused() -> None:
    async with listening(LIMITS, echo) as port, client(port) as connection:
        with contextlib.suppress(ConnectionClosedError):
            for number in range(10_000):
                await connection.ping(b"%08d" % number)
        assert await close_code(connection) == 1008


async def test_client_that_answers_no_ping_is_closed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("eskin.runtime.http_server.listener.PING_S", 0.05)
    monkeypatch.setattr("eskin.runtime.http_server.listener.PONG_S", 0.2)
    async with listening(LIMITS, echo) as port:
        async with client(port) as connection:  # which answers
            await asyncio.sleep(0.5)
            await connection.send("still here")
            assert await connection.recv() == "still here"
        said = await say(port, upgrade())
    assert said.startswith(b"HTTP/1.1 101")
    assert said.count(b"\x89\x04") == 1  # a ping, and no other before the answer
    assert b"keepalive" in said


async def flood(scope: Scope, receive: Receive, send: Send) -> None:
    """Sends without end."""
    del scope
    await receive()
    await send({"type": "websocket.accept"})
    with contextlib.suppress(OSError):
        while True:
            await send({"type": "websocket.send", "bytes": bytes(10_000)})


async def test_no_more_is_sent_than_a_client_may_leave_unread() -> None:
    async with listening(LIMITS, flood) as port:
        reader, writer = await asyncio.open_connection("127.0.0.1", port, limit=1 << 24)
        writer.write(upgrade())
        await reader.readuntil(b"\r\n\r\n")
        came, size = bytearray(), WINDOW_BYTES + 10_000
        while len(came) < WINDOW_BYTES:  # the client takes all, and answers no ping
            came += await asyncio.wait_for(reader.read(1 << 20), PATIENCE_S)
        with contextlib.suppress(TimeoutError):
            came += await asyncio.wait_for(reader.read(1 << 20), 0.3)
        assert len(came) < size
        # What it answers says how far it has read.
        writer.write(b"\x8a\x85" + bytes(4) + b"probe")
        while len(came) < size:
            came += await asyncio.wait_for(reader.read(1 << 20), PATIENCE_S)
        writer.close()


async def test_client_that_answers_pings_is_sent_all() -> None:
    async with listening(LIMITS, flood) as port, client(port) as connection:
        for _ in range(100):
            assert len(await connection.recv()) == 10_000


async def test_client_that_takes_nothing_is_let_go(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("eskin.runtime.http_server.websocket._STALLED_S", 0.5)
    sent = 0
    over = asyncio.Event()

    async def counted(scope: Scope, receive: Receive, send: Send) -> None:
        async def sending(message: Message) -> None:
            nonlocal sent
            await send(message)
            sent += 1

        await flood(scope, receive, sending)
        over.set()

    async with listening(LIMITS, counted) as port:
        with socket.socket() as silent:
            silent.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
            silent.setblocking(False)  # noqa: FBT003 - its only parameter
            loop = asyncio.get_running_loop()
            await loop.sock_connect(silent, ("127.0.0.1", port))
            await loop.sock_sendall(silent, upgrade())
            await asyncio.wait_for(over.wait(), PATIENCE_S)
    assert 1 < sent < WINDOW_BYTES // 10_000 + 3


async def test_name_of_another_server_is_refused() -> None:
    limits = HttpLimits(message_bytes=4096, hosts=LOCALHOST)
    async with listening(limits, echo) as port:
        assert await status(port, upgrade()) == 421
        async with client(port) as connection:  # by address
            await connection.send("x")
            assert await connection.recv() == "x"


async def test_application_without_websockets_answers_the_plain_request() -> None:
    async with listening(HttpLimits(), echo) as port:
        assert (await say(port, upgrade(more=b"Connection: close\r\n"))).endswith(
            b"plain\r\n0\r\n\r\n"
        )


async def test_other_methods_are_not_upgraded() -> None:
    async with listening(LIMITS, echo) as port:
        said = await say(port, upgrade(method=b"POST", more=b"Connection: close\r\n"))
    assert said.startswith(b"HTTP/1.1 200")


async def test_request_behind_one_that_is_being_answered_is_not_upgraded() -> None:
    answering = asyncio.Event()

    async def slow(scope: Scope, receive: Receive, send: Send) -> None:
        if scope["path"] == "/slow":
            await answering.wait()
        await echo(scope, receive, send)

    async with listening(LIMITS, slow) as port:
        reader, writer = await asyncio.open_connection("127.0.0.1", port)
        writer.write(b"GET /slow HTTP/1.1\r\nHost: here\r\n\r\n" + upgrade())
        await writer.drain()
        async with client(port):  # by now the server has read both
            answering.set()
        first = await asyncio.wait_for(reader.readuntil(b"plain"), PATIENCE_S)
        assert first.startswith(b"HTTP/1.1 200")
        writer.close()


@pytest.mark.parametrize("more", [b"X: " + b"x" * 9000 + b"\r\n", b"X: x\r\n" * 200])
async def test_head_that_the_library_does_not_read_ends_the_connection(more: bytes) -> None:
    async with listening(LIMITS, echo) as port:
        assert b" 101 " not in await say(port, upgrade(more=more))


async def test_websockets_count_as_connections() -> None:
    limits = HttpLimits(message_bytes=4096, of_one=3)
    async with listening(limits, echo) as port, contextlib.AsyncExitStack() as stack:
        opened = [await stack.enter_async_context(client(port)) for _ in range(3)]
        with pytest.raises(InvalidStatus) as caught:
            await client(port)
        assert caught.value.response.status_code == 503
        for connection in opened:  # none of them gave way
            await connection.send("x")
            assert await connection.recv() == "x"


async def test_websockets_count_for_a_caller_that_proved_its_name() -> None:
    limits = HttpLimits(message_bytes=4096, of_one=3)
    async with listening(limits, echo) as port, contextlib.AsyncExitStack() as stack:
        for _ in range(3):
            await stack.enter_async_context(client(port, "/named"))
        other = await stack.enter_async_context(client(port))  # the address has room again
        await other.send("x")
        assert await other.recv() == "x"
        fourth = await stack.enter_async_context(client(port, "/named"))
        assert await close_code(fourth) == 1008


async def test_stopping_server_says_so() -> None:
    async with listening(LIMITS, echo) as port:
        connection = await client(port)
        await connection.send("x")
        await connection.recv()
    with pytest.raises(ConnectionClosed) as caught:
        await connection.recv()
    assert caught.value.rcvd is not None
    assert caught.value.rcvd.code == 1012
