"""A listener gives outsiders no more time, bytes and connections than it says; on real sockets."""

from __future__ import annotations

import asyncio
import json
import socket
from contextlib import asynccontextmanager, suppress
from dataclasses import replace
from ipaddress import ip_network
from typing import TYPE_CHECKING

import pytest

from eskin.runtime.http_server.connection_limits import CALLER
from eskin.runtime.http_server.listener import Listener, bind
from eskin.runtime.http_server.protocol import LOCALHOST, PROMPT, HttpLimits
from tests.unit.eskin.passing import LONG_S, outlast

if TYPE_CHECKING:
    import ssl
    from collections.abc import AsyncIterator

    from starlette.types import ASGIApp, Receive, Scope, Send

pytestmark = pytest.mark.anyio
BRIEF = HttpLimits(head_s=0.2, body_s=0.2, head_bytes=2000, body_bytes=100)
"""For who is refused so, however slowly we ourselves ask."""
PATIENT = HttpLimits(head_s=LONG_S, body_s=LONG_S, head_bytes=2000, body_bytes=100)
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
    bounds: HttpLimits, app: ASGIApp = application, *, context: ssl.SSLContext | None = None
) -> AsyncIterator[int]:
    """A listener; gives its port."""
    bound = bind("people", "127.0.0.1", 0)
    port = bound.getsockname()[1]
    listener = Listener(app, bound, context=context, bounds=bounds)
    task = asyncio.create_task(listener.serve())
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


async def test_silent_client_is_let_go() -> None:
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
        stated = await outlast(monkeypatch, port, said, answer=b"\r\n\r\n")
        assert stated.startswith(b"HTTP/1.1 200")
        assert stated.count(b"HTTP/1.1 200") == 1  # and then it was closed


async def test_body_that_never_ends_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    post = b"POST / HTTP/1.1\r\nHost: here\r\nContent-Length: 50\r\n\r\nsome"
    async with listening(PATIENT) as port:
        assert status_of(await outlast(monkeypatch, port, post)) == 408


async def test_body_after_its_answer_is_not_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    post = b"POST /early HTTP/1.1\r\nHost: here\r\nContent-Length: 50\r\n\r\nsome"
    async with listening(PATIENT) as port:
        stated = await outlast(monkeypatch, port, post, answer=b"early")
        assert stated.startswith(b"HTTP/1.1 200")


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


async def test_longest_idle_connection_gives_way() -> None:
    last = GET.replace(b"\r\n\r\n", b"\r\nConnection: close\r\n\r\n")
    async with listening(HttpLimits(of_one=2)) as port:
        held = [await asyncio.open_connection("127.0.0.1", port) for _ in range(2)]
        (oldest, _), (younger, writer) = held
        assert (await say(port, last)).startswith(b"HTTP/1.1 200")
        assert await asyncio.wait_for(oldest.read(), 20.0) == b""
        writer.write(last)
        assert (await asyncio.wait_for(younger.read(), 20.0)).startswith(b"HTTP/1.1 200")
        for _, each in held:
            each.close()


async def test_client_that_is_being_answered_does_not_give_way() -> None:
    asked: asyncio.Queue[str] = asyncio.Queue()
    end = asyncio.Event()

    async def slow(scope: Scope, receive: Receive, send: Send) -> None:
        asked.put_nowait(scope["path"])
        await end.wait()
        await application(scope, receive, send)

    async with listening(HttpLimits(of_one=2), slow) as port:
        held = [await asyncio.open_connection("127.0.0.1", port) for _ in range(2)]
        for _, writer in held:
            writer.write(GET)
            await asyncio.wait_for(asked.get(), 20.0)
        assert await status(port) == 503
        end.set()
        for reader, writer in held:
            assert (await asyncio.wait_for(reader.readline(), 20.0)).startswith(b"HTTP/1.1 200")
            writer.close()


async def ended(reader: asyncio.StreamReader) -> bool:
    """Wait until a connection is ended without a word."""
    with suppress(ConnectionResetError):
        return await asyncio.wait_for(reader.read(), 20.0) == b""
    return True


LAST = GET.replace(b"\r\n\r\n", b"\r\nConnection: close\r\n\r\n")


async def test_connection_whose_body_never_ends_gives_way() -> None:
    post = b"POST / HTTP/1.1\r\nHost: here\r\nContent-Length: 50\r\n\r\nabc"
    async with listening(replace(PATIENT, of_one=2)) as port:
        held = [await asyncio.open_connection("127.0.0.1", port) for _ in range(2)]
        for _, writer in held:
            writer.write(post)
        assert (await say(port, LAST)).startswith(b"HTTP/1.1 200")
        assert await ended(held[0][0])
        for _, writer in held:
            writer.close()


async def test_caller_who_proved_its_name_does_not_count_for_its_address() -> None:
    async def identifying(scope: Scope, receive: Receive, send: Send) -> None:
        if scope["path"] != "/path":
            scope["extensions"][CALLER]["identify"](scope["path"])
        await application(scope, receive, send)

    async def known(name: bytes) -> tuple[asyncio.StreamReader, asyncio.StreamWriter]:
        reader, writer = await asyncio.open_connection("127.0.0.1", port)
        await again(reader, writer, name)
        return reader, writer

    async def again(
        reader: asyncio.StreamReader, writer: asyncio.StreamWriter, name: bytes
    ) -> None:
        writer.write(GET.replace(b"/path", name))
        assert (await asyncio.wait_for(reader.readuntil(b"\r\n\r\n"), 20.0))[9:12] == b"200"

    async with listening(replace(PATIENT, of_one=2, connections=5), identifying) as port:
        ada = await known(b"/ada")
        crowd = [await asyncio.open_connection("127.0.0.1", port) for _ in range(8)]
        bo = [await known(b"/bo") for _ in range(3)]
        assert await ended(bo[0][0]), "of one caller the longest idle gives way, too"
        await again(*ada, b"/ada")
        await again(*bo[1], b"/bo")
        for _, writer in (*crowd, *bo, ada):
            writer.close()


@pytest.mark.parametrize(
    ("host", "expected"),
    [
        (b"localhost", 200), (b"LOCALHOST:80", 200), (b"127.0.0.1:8080", 200), (b"[::1]:80", 200),
        (b"192.0.2.7", 200), (b"evil.example", 421), (b"localhost.evil.example", 421),
        (b"[::1", 421), (b"", 421), (b"a\r\nHost: localhost", 400), (b"127.0.0.1.nip.io", 421),
    ],
)  # fmt: skip
async def test_host_that_is_no_name_of_ours_is_refused(host: bytes, expected: int) -> None:
    async with listening(replace(PATIENT, hosts=LOCALHOST)) as port:
        said = await say(port, LAST.replace(b"here", host))
        assert said.split()[1] == str(expected).encode()
        if expected != 200:
            assert status_of(said) == expected
        assert status_of(await say(port, b"GET / HTTP/1.1\r\n\r\n")) == 400


PROXIES = (ip_network("127.0.0.0/8"), ip_network("10.0.0.0/8"))


@pytest.mark.parametrize(
    ("header", "client"),
    [
        (b"", "127.0.0.1"),
        (b"X-Forwarded-For: 192.0.2.1\r\n", "192.0.2.1"),
        (b"X-Forwarded-For: 198.51.100.9, 192.0.2.1\r\n", "192.0.2.1"),
        (b"X-Forwarded-For: 198.51.100.9\r\nX-Forwarded-For: 192.0.2.1, 10.1.2.3\r\n", "192.0.2.1"),
        (b"X-Forwarded-For: 192.0.2.1:4711\r\n", "192.0.2.1"),
        (b"X-Forwarded-For: [2001:db8::1]:4711\r\n", "2001:db8::1"),
        (b"X-Forwarded-For: 2001:db8::1\r\n", "2001:db8::1"),
        (b"X-Forwarded-For: 192.0.2.1, nonsense, 10.1.2.3\r\n", "10.1.2.3"),
        (b"X-Forwarded-For: ,\r\n", "127.0.0.1"),
        (b"Forwarded: for=192.0.2.1\r\n", "127.0.0.1"),
    ],
)  # fmt: skip
async def test_client_is_the_one_that_a_trusted_proxy_names(header: bytes, client: str) -> None:
    assert await client_of(replace(PATIENT, proxies=PROXIES), header) == client
    assert await client_of(PATIENT, header) == "127.0.0.1", "no other client is"


@pytest.mark.parametrize(
    ("header", "client"),
    [
        (b'Forwarded: for="[2001:db8::1]:4711";proto=https\r\n', "2001:db8::1"),
        (b"Forwarded: for=198.51.100.9, For=192.0.2.1;by=10.0.0.1\r\n", "192.0.2.1"),
        (b"Forwarded: for=unknown\r\n", "127.0.0.1"),
        (b"X-Forwarded-For: 192.0.2.1\r\n", "127.0.0.1"),
    ],
)
async def test_forwarded_is_read_where_it_is_chosen(header: bytes, client: str) -> None:
    bounds = replace(PATIENT, proxies=PROXIES, forwarded="forwarded")
    assert await client_of(bounds, header) == client


async def client_of(bounds: HttpLimits, header: bytes) -> str:
    """The client that an application sees."""
    clients: list[str] = []

    async def noting(scope: Scope, receive: Receive, send: Send) -> None:
        clients.append(scope["client"][0])
        await application(scope, receive, send)

    async with listening(bounds, noting) as port:
        await say(port, LAST.replace(b"\r\n\r\n", b"\r\n" + header + b"\r\n"))
    return clients[0]


async def test_connections_of_a_proxy_have_no_bound_of_one_address() -> None:
    async with listening(replace(PATIENT, of_one=2, proxies=PROXIES)) as port:
        held = [await asyncio.open_connection("127.0.0.1", port) for _ in range(6)]
        for reader, writer in held:
            writer.write(LAST)
            assert (await asyncio.wait_for(reader.read(), 20.0)).startswith(b"HTTP/1.1 200")
            writer.close()


@pytest.mark.nightly
@pytest.mark.parametrize(
    "close", [b"", pytest.param(b"Connection: close\r\n", marks=pytest.mark.nightly)]
)
async def test_slow_reader_is_served_to_the_end_and_one_that_stops_is_not(
    monkeypatch: pytest.MonkeyPatch, close: bytes
) -> None:
    monkeypatch.setattr("eskin.runtime.http_server.protocol._STALLED_S", 0.5)
    size, piece = 400_000, 16_384

    async def long(scope: Scope, receive: Receive, send: Send) -> None:
        del scope, receive
        head = [(b"content-length", str(size).encode())]
        await send({"type": "http.response.start", "status": 200, "headers": head})
        for at in range(0, size, piece):
            body = bytes(min(piece, size - at))
            more = at + piece < size
            await send({"type": "http.response.body", "body": body, "more_body": more})

    async def slow(pause: float) -> int:
        with socket.socket() as client:
            client.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
            client.setblocking(False)  # noqa: FBT003 - its only parameter
            loop = asyncio.get_running_loop()
            await loop.sock_connect(client, ("127.0.0.1", port))
            asked = GET.replace(b"\r\n\r\n", b"\r\n" + close + b"\r\n")
            await loop.sock_sendall(client, asked)
            taken = 0
            with suppress(ConnectionResetError):
                while taken < size:
                    await asyncio.sleep(pause)
                    part = await loop.sock_recv(client, 4096)
                    if not part:
                        break
                    taken += len(part)
            return taken

    async with listening(replace(PATIENT, head_s=0.5), long) as port:
        assert await slow(0.01) >= size, "over a second, of which no half is without progress"
        assert await slow(0.8) < size


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
