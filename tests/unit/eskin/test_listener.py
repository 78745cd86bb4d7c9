"""Connections without a handshake are bounded in number and in time."""

from __future__ import annotations

import asyncio
import socket
import ssl
from contextlib import AsyncExitStack
from dataclasses import replace
from typing import TYPE_CHECKING

import pytest

from eskin.identity import IdentityKind, server_context
from eskin.runtime.http_server.connection_limits import MARGIN
from eskin.runtime.http_server.protocol import HttpLimits
from tests.support.processes import wait_until
from tests.unit.eskin.passing import LONG_S, pass_time
from tests.unit.eskin.test_connection_limits import GET, listening, say

if TYPE_CHECKING:
    from tests.support.identities import Identities

pytestmark = pytest.mark.anyio
FEW = HttpLimits(head_s=LONG_S, of_one=2, connections=100)


@pytest.fixture
def anyio_backend() -> str:
    return "asyncio"


@pytest.fixture
def context(identities: Identities) -> ssl.SSLContext:
    folder = identities.make(IdentityKind.SERVER, "server.listener").directory
    return server_context(folder, client_certificates=False)


async def silent(port: int, stack: AsyncExitStack) -> asyncio.StreamReader:
    """Connect, and say nothing."""
    reader, writer = await asyncio.open_connection("127.0.0.1", port)
    stack.callback(writer.close)
    return reader


async def ask(port: int, *, come_from: str) -> bytes:
    """What a request by TLS is answered."""
    trusting = ssl.create_default_context()
    trusting.check_hostname, trusting.verify_mode = False, ssl.CERT_NONE
    reader, writer = await asyncio.open_connection(
        "127.0.0.1", port, ssl=trusting, local_addr=(come_from, 0)
    )
    try:
        writer.write(GET)
        return await reader.readline()
    finally:
        writer.close()


async def test_silent_connections_of_one_address_give_way(context: ssl.SSLContext) -> None:
    async with listening(FEW, context=context) as port, AsyncExitStack() as stack:
        waiting = [await silent(port, stack) for _ in range(20)]
        # The first of them are ended, and who means it is answered, from the same address, too.
        assert await asyncio.wait_for(waiting[0].read(), 20) == b""
        assert b" 200 " in await ask(port, come_from="127.0.0.1")
        assert b" 200 " in await ask(port, come_from="127.0.0.2")
        assert not waiting[-1].at_eof()


async def test_silent_connections_of_many_addresses_give_way(context: ssl.SSLContext) -> None:
    few = replace(FEW, connections=5)
    async with listening(few, context=context) as port, AsyncExitStack() as stack:
        for number in range(2 * (few.connections + MARGIN)):
            _, writer = await asyncio.open_connection(
                "127.0.0.1", port, local_addr=(f"127.0.1.{number + 1}", 0)
            )
            stack.callback(writer.close)
        assert b" 200 " in await ask(port, come_from="127.0.0.1")


async def test_handshake_that_is_not_begun_in_time_is_ended(
    context: ssl.SSLContext, monkeypatch: pytest.MonkeyPatch
) -> None:
    async with listening(FEW, context=context) as port, AsyncExitStack() as stack:
        waiting = [asyncio.create_task((await silent(port, stack)).read()) for _ in range(3)]
        await pass_time(monkeypatch, lambda: all(each.done() for each in waiting))
        assert [each.result() for each in waiting] == [b""] * 3
        assert b" 200 " in await ask(port, come_from="127.0.0.1")


async def test_network_of_one_ipv6_user_is_one_source(
    context: ssl.SSLContext, monkeypatch: pytest.MonkeyPatch
) -> None:
    received_messages = iter(
        [*(f"2001:db8:1:2::{k + 1:x}" for k in range(3)), "2001:db8:1:3::1", "::1"]
    )
    outside: list[socket.socket] = []

    def accept(_: socket.socket) -> tuple[socket.socket, tuple[str, int, int, int]]:
        address = next(received_messages, None)
        if address is None:
            raise BlockingIOError
        guest, peer = socket.socketpair()
        peer.settimeout(20)
        outside.append(peer)
        return guest, (address, 1024, 0, 0)

    monkeypatch.setattr(socket.socket, "accept", accept)
    async with listening(FEW, context=context) as port, AsyncExitStack() as stack:
        await silent(port, stack)
        await asyncio.to_thread(wait_until, lambda: bool(outside), "they are accepted")
        assert await asyncio.to_thread(lambda: outside[0].recv(1)) == b"", "one of three is ended"
        assert len(outside) == 5
        for peer in outside[1:]:
            peer.setblocking(False)  # noqa: FBT003 - its only parameter
            with pytest.raises(BlockingIOError):
                peer.recv(1)
    for peer in outside:
        peer.close()


async def test_listener_that_has_no_descriptors_left_accepts_again(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    accept, failures = socket.socket.accept, [OSError(24, "too many open files")]

    def fail_once(bound: socket.socket) -> object:
        if failures:
            raise failures.pop()
        return accept(bound)

    monkeypatch.setattr(socket.socket, "accept", fail_once)
    async with listening(FEW) as port:
        said = await say(port, GET.replace(b"Host", b"Connection: close\r\nHost"))
        assert b" 200 " in said
