"""Packets that come up together leave together, in their order, and none is left behind."""

from __future__ import annotations

import asyncio
from typing import cast

import pytest

from eskin.demo.broker.broker import BatchingWriter

pytestmark = pytest.mark.anyio


@pytest.fixture
def anyio_backend() -> str:
    return "asyncio"


class Wire:
    """Stands in for a stream writer; keeps each write."""

    def __init__(self) -> None:
        self.writes: list[bytes] = []
        self.closed = False

    def write(self, data: bytes) -> None:
        self.writes.append(data)

    async def drain(self) -> None:
        await asyncio.sleep(0)

    def can_write_eof(self) -> bool:
        return False

    def close(self) -> None:
        self.closed = True

    async def wait_closed(self) -> None:
        pass


def on(wire: Wire) -> BatchingWriter:
    return BatchingWriter(cast("asyncio.StreamWriter", wire))


async def test_packets_of_one_turn_are_one_write() -> None:
    wire = Wire()
    writer = on(wire)
    writer.write(b"PUBACK ")
    writer.write(bytearray(b"PUBLISH "))
    assert wire.writes == []
    await writer.drain()
    writer.write(b"PINGRESP")
    await writer.drain()
    assert wire.writes == [b"PUBACK PUBLISH ", b"PINGRESP"]


async def test_what_is_held_is_written_before_the_end() -> None:
    wire = Wire()
    writer = on(wire)
    writer.write(b"CONNACK")
    await writer.close()
    writer.write(b"late")
    await asyncio.sleep(0)
    assert wire.closed
    assert wire.writes == [b"CONNACK"]
