"""A listener gives strangers no more time, bytes and connections than it says; on real sockets."""

from __future__ import annotations

import asyncio
import json
import socket
from contextlib import asynccontextmanager
from typing import TYPE_CHECKING

import pytest

from eskin.doorway import bind
from eskin.listener import Listener
from eskin.listening import PROMPT, Bounds
from tests.eskin.passing import LONG_S, outlast

if TYPE_CHECKING:
    import ssl
    from collections.abc import AsyncIterator

    from starlette.types import ASGIApp, Receive, Scope, Send

pytestmark = pytest.mark.anyio
BRIEF = Bounds(head_s=0.2, body_s=0.2, head_bytes=2000, body_bytes=100)
"""For who is refused so, however slowly we ourselves ask."""
PATIENT = Bounds(head_s=LONG_S, body_s=LONG_S, head_bytes=2000, body_bytes=100)
GET = b"GET /path HTTP/1.1\r\nHost: here\r\n\r\n"


@pytest.fixture
def anyio_backend() -> str:
    return "asyncio"


async def application(scope: Scope, receive: Receive, send: Send) -> None:
    """Answers with the body; at ``/early`` without waiting for it."""
    body = b"early"
    if scope["path"] != "/early":
        body, more = b"", True
        while more:
            message = await receive()
            more = message.get("more_body", False)
            body += message.get("body", b"")
    head = [(b"content-length", str(len(body)).encode())]
    await send({"type": "http.response.start", "status": 200, "headers": head})
    await send({"type": "http.response.body", "body": body})


@asynccontextmanager
async def listening(
    bounds: Bounds, app: ASGIApp = application, *, context: ssl.SSLContext | None = None
) -> AsyncIterator[int]:
    """A listener; gives its port."""
    bound = bind("people", "127.0.0.1", 0)
    port = bound.getsockname()[1]
    listener = Listener(app, bound, context=context, bounds=bounds)
    task = asyncio.create_task(listener.run_until_told())
    await listener.ready.wait()
    try:
        yield port
    finally:
        listener.should_exit = True
        await task


async def say(port: int, *parts: bytes) -> bytes:
    """Connect, send, and give all that comes until the other side closes."""
    reader, writer = await asyncio.open_connection("127.0.0.1", port)
    try:
        for part in parts:
            writer.write(part)
            await writer.drain()
        return await asyncio.wait_for(reader.read(), 20.0)
    except ConnectionResetError:
        return b""
    finally:
        writer.close()


def status_of(answer: bytes) -> int:
    """The status of a refusal, which is problem details."""
    head, _, body = answer.partition(b"\r\n\r\n")
    assert b"application/problem+json" in head
    assert json.loads(body)["status"] == int(head.split()[1])
    return int(head.split()[1])


async def status(port: int, *parts: bytes) -> int:
    """The status of what is refused so."""
    return status_of(await say(port, *parts))


async def test_head_that_never_ends_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    head = b"GET / HTTP/1.1\r\nHost: here\r\nX-Slow: "
    async with listening(PATIENT) as port:
        assert status_of(await outlast(monkeypatch, port, head)) == 408


async def test_whoever_says_nothing_is_let_go() -> None:
    async with listening(BRIEF) as port:
        assert await say(port) == b""


async def test_drop_by_drop_earns_no_more_time() -> None:
    async with listening(BRIEF) as port:
        reader, writer = await asyncio.open_connection("127.0.0.1", port)

        async def drip() -> None:
            while not reader.at_eof():
                writer.write(b"\r\n")
                await asyncio.sleep(0.01)

        dripping = asyncio.create_task(drip())
        said = await asyncio.wait_for(asyncio.gather(reader.read(), return_exceptions=True), 20.0)
        dripping.cancel()
        writer.close()
        assert b"200" not in bytes(said[0] if isinstance(said[0], bytes) else b"")


async def test_second_head_on_a_connection_has_its_time_too(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    async with listening(PATIENT) as port:
        said = GET + b"GET / HTTP/1.1\r\nHost: "
        told = await outlast(monkeypatch, port, said, answer=b"\r\n\r\n")
        assert told.startswith(b"HTTP/1.1 200")
        assert told.count(b"HTTP/1.1 200") == 1  # and then it was closed


async def test_body_that_never_ends_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    post = b"POST / HTTP/1.1\r\nHost: here\r\nContent-Length: 50\r\n\r\nsome"
    async with listening(PATIENT) as port:
        assert status_of(await outlast(monkeypatch, port, post)) == 408


async def test_body_after_its_answer_is_not_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    post = b"POST /early HTTP/1.1\r\nHost: here\r\nContent-Length: 50\r\n\r\nsome"
    async with listening(PATIENT) as port:
        told = await outlast(monkeypatch, port, post, answer=b"early")
        assert told.startswith(b"HTTP/1.1 200")


@pytest.mark.parametrize(
    "head",
    [
        b"GET /" + b"a" * 3000,
        b"GET / HTTP/1.1\r\nHost: here\r\nX: " + b"a" * 3000,
        b"GET / HTTP/1.1\r\nHost: here\r\nX: " + b"a" * 3000 + b"\r\n\r\n",
        b"GET / HTTP/1.1\r\n" + b"X: y\r\n" * 500 + b"\r\n",
    ],
)
async def test_long_head_is_refused_at_once(head: bytes) -> None:
    async with listening(PATIENT) as port:
        assert await status(port, head) == 431


@pytest.mark.parametrize(
    "body",
    [
        b"Content-Length: 101\r\n\r\n" + b"a" * 101,
        b"Transfer-Encoding: chunked\r\n\r\n32\r\n" + b"a" * 50 + b"\r\n" + b"33\r\n" + b"a" * 51,
    ],
)
async def test_long_body_is_refused_at_once(body: bytes) -> None:
    async with listening(PATIENT) as port:
        assert await status(port, b"POST / HTTP/1.1\r\nHost: here\r\n" + body) == 413


async def test_no_http_is_refused() -> None:
    async with listening(PATIENT) as port:
        assert await status(port, b"\x16\x03\x01\x00 hello\r\n\r\n") == 400


async def test_one_address_gets_so_many_connections() -> None:
    async with listening(Bounds(of_one=2)) as port:
        held = [await asyncio.open_connection("127.0.0.1", port) for _ in range(2)]
        assert await status(port) == 503
        for _, writer in held:
            writer.close()
            await writer.wait_closed()
        last = GET.replace(b"\r\n\r\n", b"\r\nConnection: close\r\n\r\n")
        while not (said := await say(port, last)).startswith(b"HTTP/1.1 200"):
            assert b"503" in said or not said  # until the listener has noticed


async def test_where_the_idle_give_way_the_newest_is_answered() -> None:
    last = GET.replace(b"\r\n\r\n", b"\r\nConnection: close\r\n\r\n")
    async with listening(Bounds(of_one=2, gives_way=True)) as port:
        held = [await asyncio.open_connection("127.0.0.1", port) for _ in range(2)]
        (oldest, _), (younger, writer) = held
        assert (await say(port, last)).startswith(b"HTTP/1.1 200")
        assert await asyncio.wait_for(oldest.read(), 20.0) == b""
        writer.write(last)
        assert (await asyncio.wait_for(younger.read(), 20.0)).startswith(b"HTTP/1.1 200")
        for _, each in held:
            each.close()


async def test_whoever_is_being_answered_does_not_give_way() -> None:
    asked: asyncio.Queue[str] = asyncio.Queue()
    end = asyncio.Event()

    async def slow(scope: Scope, receive: Receive, send: Send) -> None:
        asked.put_nowait(scope["path"])
        await end.wait()
        await application(scope, receive, send)

    async with listening(Bounds(of_one=2, gives_way=True), slow) as port:
        held = [await asyncio.open_connection("127.0.0.1", port) for _ in range(2)]
        for _, writer in held:
            writer.write(GET)
            await asyncio.wait_for(asked.get(), 20.0)
        assert await status(port) == 503
        end.set()
        for reader, writer in held:
            assert (await asyncio.wait_for(reader.readline(), 20.0)).startswith(b"HTTP/1.1 200")
            writer.close()


async def test_requests_one_behind_the_other_are_answered() -> None:
    last = GET.replace(b"\r\n\r\n", b"\r\nConnection: close\r\n\r\n")
    post = b"POST / HTTP/1.1\r\nHost: here\r\nContent-Length: 3\r\n\r\nabc"
    async with listening(PATIENT) as port:
        said = await say(port, GET + post, last)
    assert said.count(b"HTTP/1.1 200") == 3
    assert b"abc" in said


async def test_prompt_answer_waits_with_its_maker_and_not_on_the_way() -> None:
    made: asyncio.Queue[int] = asyncio.Queue()

    async def endless(scope: Scope, receive: Receive, send: Send) -> None:
        if scope["path"] == "/prompt":
            scope["extensions"][PROMPT]["begin"]()
        await send({"type": "http.response.start", "status": 200, "headers": []})
        taken = 0
        try:
            while True:
                part = {"type": "http.response.body", "body": bytes(1000), "more_body": True}
                await asyncio.wait_for(send(part), 1.0)
                taken += 1000
        except TimeoutError:  # there is no room for more
            made.put_nowait(taken)
        while (await receive())["type"] != "http.disconnect":
            pass

    async def taken(path: bytes) -> int:
        with socket.socket() as idle:
            idle.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
            idle.setblocking(False)  # noqa: FBT003 - its only parameter
            loop = asyncio.get_running_loop()
            await loop.sock_connect(idle, ("127.0.0.1", port))
            await loop.sock_sendall(idle, GET.replace(b"/path", path))
            return await asyncio.wait_for(made.get(), 20.0)

    async with listening(PATIENT, endless) as port:
        assert await taken(b"/prompt") < 10_000
        assert 25_000 < await taken(b"/path") < 100_000
