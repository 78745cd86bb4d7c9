"""Clients of the live stream of frames, independent of ours: a real server, and `websockets`."""

from __future__ import annotations

import asyncio
import json
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any
from urllib.parse import urlencode

import cbor2
from eskin_cloud.api.live import MOST_MESSAGE_BYTES
from websockets.asyncio.client import connect

from eskin.runtime.http_server.protocol import LOCALHOST, HttpLimits
from tests.unit.eskin.test_connection_limits import listening

if TYPE_CHECKING:
    from collections.abc import AsyncIterator

    from websockets.asyncio.client import ClientConnection

    from tests.unit.cloud.clouds import Stand

PATIENCE_S = 20.0


@asynccontextmanager
async def serving(stand: Stand) -> AsyncIterator[int]:
    """The people's listener of a cloud, with its limits; gives its port."""
    limits = HttpLimits(message_bytes=MOST_MESSAGE_BYTES, hosts=LOCALHOST)
    async with listening(limits, stand.people) as port:
        yield port
        stand.cloud.feed.close()


def dial(
    port: int,
    token: str,
    *,
    node: tuple[str, ...] = (),
    headers: dict[str, str] | None = None,
    **options: Any,
) -> connect:
    """Open a stream; without a token where it is empty."""
    asked = {key: options.pop(key) for key in ("cursor",) if options.get(key)}
    query = urlencode([*(("node", name) for name in node), *asked.items()])
    proof = {"Authorization": f"Bearer {token}"} if token else {}
    return connect(
        f"ws://127.0.0.1:{port}/api/v1/live?{query}",
        additional_headers=proof | (headers or {}),
        proxy=None,
        **options,
    )


@dataclass
class Received:
    """What a client got, over all its connections.

    Attributes:
        cursor: Where to go on.
        frames: Frames with their nodes, in order.
        layouts: Hashes of layouts by node.
        events: Events in JSON.
        contacts: Contacts in JSON.
        skipped: How many frames it was not sent.
        cursors: Those of frames, events and lags, in order.
    """

    cursor: str = ""
    frames: list[tuple[str, bytes]] = field(default_factory=list)
    layouts: list[tuple[str, bytes]] = field(default_factory=list)
    events: list[dict[str, Any]] = field(default_factory=list)
    contacts: list[dict[str, Any]] = field(default_factory=list)
    skipped: int = 0
    cursors: list[str] = field(default_factory=list)

    def take(self, message: str | bytes) -> str:
        """Read a message; gives its kind."""
        assert isinstance(message, bytes)
        kind, *rest = cbor2.loads(message)
        if kind == "layout":
            node, name = rest
            self.layouts.append((node, name))
            return str(kind)
        cursor, *rest = rest
        self.cursor = cursor
        self.cursors.append(cursor)
        if kind == "contacts":
            node, text = rest
            self.contacts.append(json.loads(text))
            assert self.contacts[-1]["node"] == node
        elif kind == "frame":
            node, received, data = rest
            assert isinstance(received, int)
            self.frames.append((node, data))
        elif kind == "event":
            named, text = rest
            event = json.loads(text)
            assert event["kind"] == named
            self.events.append(event)
        else:
            assert kind == "lagging"
            self.skipped += rest[0]
        return str(kind)

    async def read(self, connection: ClientConnection, *, frames: int = 0, events: int = 0) -> None:
        """Read until there are so many frames, received or skipped, and events."""
        async with asyncio.timeout(PATIENCE_S):
            while len(self.frames) + self.skipped < frames or len(self.events) < events:
                self.take(await connection.recv())
