"""A broker in an attacker's hand: knows its own key and everything that passes, nothing else."""

from __future__ import annotations

import asyncio
from threading import Event, Thread
from typing import TYPE_CHECKING, Any, Self

from eskin.demo.broker import LoopbackBroker
from eskin.demo.broker.client_auth import ClientAuth
from eskin.wire.topics import FROM_NODE, NODES
from tests.support.processes import free_port

if TYPE_CHECKING:
    from collections.abc import Iterator

    from tests.support.identities import Identities

NAMES = ("fingertip", "palm")


class Malice:
    """What it does to each message, one trick after the other. ``done`` counts them."""

    def __init__(self) -> None:
        self.evil = True
        self.seen: list[tuple[str, bytes]] = []
        self.done = 0

    def __call__(self, topic: str, data: bytes) -> Iterator[tuple[str, bytes]]:
        self.seen.append((topic, data))
        if not self.evil or not topic.startswith(NODES) or not data:
            yield topic, data
            return
        tricks = (
            self._drop, self._forge, self._replay, self._redirect,
            self._truncate, self._reorder, self._move, self._echo,
        )  # fmt: skip
        self.done += 1
        yield from tricks[self.done % len(tricks)](topic, data)

    def _drop(self, _topic: str, _data: bytes) -> Iterator[tuple[str, bytes]]:
        yield from ()

    def _forge(self, topic: str, data: bytes) -> Iterator[tuple[str, bytes]]:
        for at in (1, len(data) // 2, len(data) - 1):
            yield topic, data[:at] + bytes([data[at] ^ 1]) + data[at + 1 :]

    def _replay(self, topic: str, data: bytes) -> Iterator[tuple[str, bytes]]:
        yield topic, data
        yield topic, data
        yield from [seen for seen in self.seen[:-1] if seen[0] == topic][-20::4]

    def _redirect(self, topic: str, data: bytes) -> Iterator[tuple[str, bytes]]:
        this, other = NAMES if f"/{NAMES[0]}/" in topic else NAMES[::-1]
        yield topic.replace(f"/{this}/", f"/{other}/"), data

    def _truncate(self, topic: str, data: bytes) -> Iterator[tuple[str, bytes]]:
        for size in (0, 1, len(data) // 2, len(data) - 1):
            yield topic, data[:size]

    def _reorder(self, topic: str, data: bytes) -> Iterator[tuple[str, bytes]]:
        yield from [seen for seen in self.seen if seen[0].startswith(NODES)][-5:][::-1]
        yield topic, data

    def _move(self, topic: str, data: bytes) -> Iterator[tuple[str, bytes]]:
        head, stream = topic.rsplit("/", 1)
        for other in (*FROM_NODE, "acks", "commands"):
            if other != stream:
                yield f"{head}/{other}", data

    def _echo(self, topic: str, data: bytes) -> Iterator[tuple[str, bytes]]:
        """What a node said, back to it as its acknowledgement, and the other way round."""
        head, stream = topic.rsplit("/", 1)
        yield f"{head}/{'acks' if stream in FROM_NODE else 'frames'}", data


class HostileBroker(LoopbackBroker):
    """Lets malice have every message."""

    malice: Malice

    async def _broadcast_message(
        self, session: Any, topic: str, data: bytes, force_qos: int | None = None
    ) -> None:
        for changed, payload in list(self.malice(topic, bytes(data))):
            await super()._broadcast_message(session, changed, payload, force_qos)


class Hostile:
    """The broker, in a thread of the test's process."""

    def __init__(self, identities: Identities, server: Any) -> None:
        self.port = free_port()
        self.malice = Malice()
        self._server = server
        self._client_auth = ClientAuth(identities.ca)
        self._ready = Event()
        self._thread = Thread(target=lambda: asyncio.run(self._serve()), daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        assert self._ready.wait(120)
        return self

    def __exit__(self, *_: object) -> None:
        self._loop.call_soon_threadsafe(self._stop.set)
        self._thread.join(20)

    async def _serve(self) -> None:
        self._loop, self._stop = asyncio.get_running_loop(), asyncio.Event()
        broker = HostileBroker(self._server, client_auth=self._client_auth, port=self.port)
        broker.malice = self.malice
        await broker.start()
        self._ready.set()
        await self._stop.wait()
        await broker.shutdown()
