"""The live stream of a skin of 8,400 taxels to 50 viewers at once: frames, and JSON beside them.

A node sends ten stretches a second, each of five pages. ``python -m benchmarks.frame_viewers``.
"""

from __future__ import annotations

import argparse
import asyncio
import base64
import os
import struct
import tempfile
import threading
import time
from dataclasses import dataclass, field, replace
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import cbor2
import numpy as np

from benchmarks.pipeline import cpu_seconds, resident_bytes
from benchmarks.report import Row
from eskin.interval import Interval
from eskin.wire.frames import Frame, Grid, Layout, Patch, PatchSamples, Seam
from eskin.wire.messages import Position
from tests.support.identities import Identities
from tests.unit.cloud.service import Service

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

_NODE: Final = "skin"
_TAXELS: Final = 8400
_COLUMNS: Final = 64
_PAGES: Final = 5
_ROWS: Final = 5
_PERIOD: Final = 20_000_000
_STRETCH: Final = _ROWS * _PERIOD
_VIEWERS: Final = 50
_RESTING: Final = 2.0
"""Seconds before a measurement."""
_BINARY, _PING, _PONG = 2, 9, 10
_SLOW_BYTES: Final = 200_000
"""A second: a quarter of what there is to tell, or less."""
_BUFFER: Final = 16_384


class Skin(NamedTuple):
    """A skin, and one stretch of it."""

    layout: Layout
    patches: tuple[Patch, ...]
    frames: tuple[Frame, ...]


def make_skin() -> Skin:
    """A grid of taxels, at rest but for two contacts."""
    sizes = [min(_COLUMNS, _TAXELS - begin) for begin in range(0, _TAXELS, _COLUMNS)]
    patches = tuple(
        Patch(
            f"p{number:03}", "pressure", "Pa",
            tuple(f"t{number * _COLUMNS + column:04}" for column in range(size)), 64.0,
            positions=(tuple(range(0, 2000 * size, 2000)), (2000 * number,) * size),
            neighbours=tuple((k, k + 1) for k in range(size - 1)),
            threshold=3000.0, cell_area=4e-6,
        )
        for number, size in enumerate(sizes)
    )  # fmt: skip
    seams = tuple(
        Seam(k, k + 1, tuple((c, c) for c in range(sizes[k + 1]))) for k in range(len(sizes) - 1)
    )
    each = -(-len(sizes) // _PAGES)
    pages = tuple(min(each, len(sizes) - begin) for begin in range(0, len(sizes), each))
    layout = Layout(tuple(patch.content_hash for patch in patches), pages, seams)
    return Skin(layout, patches, tuple(_frame(layout, sizes, page) for page in range(len(pages))))


def _frame(layout: Layout, sizes: Sequence[int], page: int) -> Frame:
    random = np.random.default_rng(page)
    packed = []
    for number in layout.page_range(page):
        lo = 500 + random.normal(0, 8, (_ROWS, sizes[number])) + random.normal(0, 60, sizes[number])
        if number % 50 < 5:
            lo[:, 20:25] += 8000
        hi = lo + 200
        packed.append(PatchSamples.pack(Interval(lo, hi), 64.0, patch=number, grid=0, first_row=0))
    grid = Grid(0, _PERIOD, 0, _ROWS, 1.0)
    return Frame(Position(1, page), layout.content_hash, page, 0, (0, 4000), (grid,), tuple(packed))


class Source:
    """Brings a cloud a stretch each 100 ms, from a thread."""

    def __init__(self, service: Service, skin: Skin) -> None:
        self._service = service
        self._skin = skin
        self._done = threading.Event()
        self._thread = threading.Thread(target=self._run, name="source")
        self.ready = threading.Event()

    def __enter__(self) -> None:
        self._thread.start()
        self.ready.wait(60.0)

    def __exit__(self, *_: object) -> None:
        self._done.set()
        self._thread.join()

    def _run(self) -> None:
        skin, first = self._skin, time.time_ns()
        self._service.admit(_NODE)
        parts: list[Patch | Layout] = [*skin.patches, skin.layout]
        described = [[_NODE, each.encode()] for each in parts]
        with self._service.gateway_client() as client:
            body = cbor2.dumps(described)
            client.post("/api/v1/descriptions", content=body).raise_for_status()
            for number in count():
                at = number * _STRETCH
                if self._done.wait(max(0.0, (first + at + _STRETCH - time.time_ns()) / 1e9)):
                    return
                said = [
                    replace(
                        each,
                        position=Position(1, number * len(skin.frames) + each.page),
                        ticks=at,
                        time=(first + at, first + at + 4000),
                    )
                    for each in skin.frames
                ]
                body = cbor2.dumps([[_NODE, each.encode()] for each in said])
                client.post("/api/v1/ingest", content=body).raise_for_status()
                self.ready.set()


@dataclass
class Viewer:
    """One stream; messages are counted, and those of one viewer in 50 are understood.

    Attributes:
        port: Of the cloud.
        token: Of a reader.
        query: Of the stream.
        binary: Whether it is a WebSocket.
        timed: Whether its frames are understood.
        said: What it asks for.
        slow: Reads so many bytes a second; 0: as many as come.
        octets: What came.
        ages: From a frame's storage to its arrival, ns.
        skipped: Frames that it was not sent.
        kinds: How many messages of each kind came.
    """

    port: int
    token: str
    query: str = ""
    binary: bool = True
    timed: bool = False
    said: str = ""
    slow: int = 0
    octets: int = 0
    ages: list[int] = field(default_factory=list)
    skipped: int = 0
    kinds: dict[str, int] = field(default_factory=dict)

    async def look(self, seconds: float) -> None:
        """Open the stream, and read."""
        limit = _BUFFER if self.slow else 1 << 20
        reader, writer = await asyncio.open_connection("127.0.0.1", self.port, limit=limit)
        upgrade = (
            "Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
            f"Sec-WebSocket-Key: {base64.b64encode(os.urandom(16)).decode()}\r\n"
        )
        writer.write(
            f"GET /api/v1/live{self.query} HTTP/1.1\r\nHost: 127.0.0.1\r\n"
            f"{upgrade if self.binary else ''}Authorization: Bearer {self.token}\r\n\r\n".encode()
        )
        try:
            async with asyncio.timeout(seconds):
                await reader.readuntil(b"\r\n\r\n")
                if self.said:
                    writer.write(_masked(0x81, self.said.encode()))
                if self.binary:
                    await self._read_messages(reader, writer)
                while piece := await reader.read(1 << 16):
                    self.octets += len(piece)
        except TimeoutError:
            pass
        finally:
            writer.transport.abort()

    async def _read_messages(
        self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter
    ) -> None:
        while True:
            first, size = await reader.readexactly(2)
            if size == 126:
                (size,) = struct.unpack("!H", await reader.readexactly(2))
            elif size == 127:
                (size,) = struct.unpack("!Q", await reader.readexactly(8))
            body = await reader.readexactly(size)
            self.octets += size
            if first & 15 == _PING:
                writer.write(_masked(0x80 | _PONG, body))
            elif self.timed and first & 15 == _BINARY:
                self._understand(body)
            if self.slow:
                await asyncio.sleep(size / self.slow)

    def _understand(self, body: bytes) -> None:
        kind, *rest = cbor2.loads(body)
        self.kinds[kind] = self.kinds.get(kind, 0) + 1
        if kind == "frame":
            self.ages.append(time.time_ns() - rest[2])
        elif kind == "lagging":
            self.skipped += rest[1] or 0


def _masked(first: int, data: bytes) -> bytes:
    """A frame of RFC 6455, section 5.2, whose mask is zero."""
    return bytes((first, 0x80 | len(data))) + bytes(4) + data


def measure_frame_viewers(folder: Path, *, seconds: float) -> list[Row]:
    """CPU of the cloud with no viewers, and with 50 of each kind."""
    folder.mkdir()
    skin = make_skin()
    service = Service(folder / "cloud", Identities(folder / "pki"))
    rows = []
    with service, Source(service, skin):
        token, port = service.token(), service.port
        alone, _ = asyncio.run(_measure(service, [], seconds))
        size = sum(len(each.encode()) for each in skin.frames)
        rows += [
            Row("live frames: bytes of a stretch", size, "B"),
            Row("live frames, no viewer: processor of the cloud", alone, "%"),
        ]
        few = '{"patches": ["p000", "p001"]}'
        for name, given in (
            ("frames of all nodes", {}),
            ("frames and contacts of a node", {"query": f"?node={_NODE}"}),
            ("frames reduced to 2 patches", {"said": few}),
            ("JSON (server-sent events)", {"binary": False}),
        ):
            options: dict[str, Any] = given
            viewers = [
                Viewer(port, token, timed=not k and options.get("binary", True), **options)
                for k in range(_VIEWERS)
            ]
            slow = Viewer(port, token, timed=True, slow=_SLOW_BYTES)
            asked = [*viewers, slow] if not options else viewers
            share, span = asyncio.run(_measure(service, asked, seconds))
            rows += _describe(f"live, {_VIEWERS} viewers, {name}", viewers, share - alone, span)
            if not options:
                rows += _describe_slow(slow)
        rows.append(Row("live frames: memory of the cloud", resident_bytes(service) / 1e6, "MB"))
    return rows


async def _measure(
    service: Service, viewers: Sequence[Viewer], seconds: float
) -> tuple[float, float]:
    """The cloud's share of a core while viewers look, and for how long that was."""
    looking = [asyncio.create_task(each.look(seconds + 2 * _RESTING)) for each in viewers]
    await asyncio.sleep(_RESTING)
    begun, spent = time.monotonic(), cpu_seconds(service)
    await asyncio.sleep(seconds)
    span = time.monotonic() - begun
    share = (cpu_seconds(service) - spent) / span * 100
    await asyncio.gather(*looking)
    return share, span


def _describe(name: str, viewers: Sequence[Viewer], share: float, span: float) -> Iterator[Row]:
    yield Row(f"{name}: processor of the cloud", share, "%")
    octets = float(np.mean([each.octets for each in viewers]))
    yield Row(f"{name}: bytes a viewer", octets / (span + 2 * _RESTING), "B/s")
    timed = viewers[0]
    if timed.ages:
        sent = sum(timed.kinds.values()) * len(viewers) / (span + 2 * _RESTING)
        yield Row(f"{name}: processor of the cloud a message", share * 1e4 / sent, "us")
        for q in (50, 99):
            age = float(np.percentile(timed.ages, q)) / 1e6
            yield Row(f"{name}: from the store to the viewer, p{q}", age, "ms")
        frames = timed.kinds["frame"] / (span + 2 * _RESTING)
        yield Row(f"{name}: frames a second", frames, "/s")
        yield Row(f"{name}: frames that were skipped", timed.skipped, "")
        yield Row(f"{name}: contacts", timed.kinds.get("contacts", 0), "")


def _describe_slow(viewer: Viewer) -> Iterator[Row]:
    name = f"live, a viewer of {_SLOW_BYTES / 1e3:g} kB/s"
    settled = viewer.ages[len(viewer.ages) // 3 :]
    yield Row(f"{name}: age of a frame, p50", float(np.median(settled)) / 1e6, "ms")
    yield Row(f"{name}: age of a frame, largest", max(settled) / 1e6, "ms")
    yield Row(f"{name}: frames that came", len(viewer.ages), "")
    yield Row(f"{name}: frames that were skipped", viewer.skipped, "")


def main() -> None:
    """Measure, and say so line by line."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.frame_viewers", description=__doc__)
    parser.add_argument("--seconds", type=float, default=15.0)
    options: Any = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="eskin-viewers-") as folder:
        rows = measure_frame_viewers(Path(folder) / "viewers", seconds=options.seconds)
    for row in rows:
        print(f"{row.name}: {row.value:.4g} {row.unit}")


if __name__ == "__main__":
    main()
