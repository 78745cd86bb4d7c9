"""A clock that a test advances, so that tests neither wait nor depend on speed."""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING, Final

from eskin.runtime.http_server.protocol import GuardedProtocol

if TYPE_CHECKING:
    from collections.abc import Callable

    import pytest

LONG_S: Final = 30.0
"""Of no effect in a test, unless it lets time pass: what waits for it is wrong."""
_STEPS: Final = 4
_LOOKS: Final = 2000


async def pass_time(monkeypatch: pytest.MonkeyPatch, until: Callable[[], bool]) -> None:
    """Let a little more than `LONG_S` pass on the event loop's clock, and wait for its effect.

    In steps: what begins meanwhile has its time, too.
    """
    true_time, ahead = asyncio.BaseEventLoop.time, 0.0
    monkeypatch.setattr(asyncio.BaseEventLoop, "time", lambda loop: true_time(loop) + ahead)
    for look in range(_LOOKS):
        if look < _STEPS:
            ahead += 1.2 * LONG_S / _STEPS
        await asyncio.sleep(0.01)
        if until():
            return
    raise AssertionError(f"nothing came of {ahead:g} s")


async def outlast(
    monkeypatch: pytest.MonkeyPatch, port: int, said: bytes, *, answer: bytes = b""
) -> bytes:
    """Say something, and let time pass once it is heard and answered.

    Args:
        monkeypatch: Turns the clock on, until the end of the test.
        port: Who is stated.
        said: In one piece.
        answer: What ends the answer that comes before.

    Returns:
        All that comes until the other side closes.
    """
    heard, whole = bytearray(), asyncio.Event()
    receive = GuardedProtocol.data_received

    def hear(protocol: GuardedProtocol, data: bytes) -> None:
        receive(protocol, data)
        heard.extend(data)
        if heard == said:
            whole.set()

    monkeypatch.setattr(GuardedProtocol, "data_received", hear)
    # uvicorn's own patience with who is idle is shorter, and not what is asked for.
    monkeypatch.setattr(GuardedProtocol, "timeout_keep_alive_handler", lambda _: None)
    reader, writer = await asyncio.open_connection("127.0.0.1", port)
    writer.write(said)
    found = await reader.readuntil(answer) if answer else b""
    await whole.wait()
    rest = asyncio.create_task(reader.read())
    await pass_time(monkeypatch, rest.done)
    writer.close()
    return found + rest.result()
