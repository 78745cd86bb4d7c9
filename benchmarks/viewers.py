"""The live stream to 200 viewers at once, to slow ones, and to ones that come back.

The cloud has one core.

``python -m benchmarks.viewers`` alone, or with the rest in ``make bench``.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import socket
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import psutil

from benchmarks.pipeline import cpu_seconds
from benchmarks.report import Row, at_most
from benchmarks.stage import Stage
from eskin.wire.timestamp import parse_timestamp

if TYPE_CHECKING:
    from collections.abc import Iterator

_VIEWERS: Final = 200
_CHANNELS: Final = 14
"""As the demo has."""
_BLOCK: Final = 50
_SLOW_BYTES: Final = 20_000
"""A second: a tenth of what there is to tell, or less."""
_BUFFER: Final = 16_384
_PERIOD: Final = 1_000_000


@dataclass
class Viewer:
    """One stream; what came is understood when time does not matter any more.

    Attributes:
        stage: Whose.
        slow: Reads so many bytes a second; 0: as many as come.
        pieces: What came and is not understood yet, with when it came (ns).
        begun: The id of the event that is being read.
        last: That of the last one that came whole, as the HTML standard has it (section 9.2.6).
        events: Blocks: id, first sample, end of the last one, arrival (ns), and the channel.
    """

    stage: Stage
    slow: int = 0
    pieces: list[tuple[int, bytes]] = field(default_factory=list)
    begun: str = ""
    last: str = ""
    events: list[tuple[int, int, int, int, str]] = field(default_factory=list)

    async def look(self, seconds: float) -> None:
        """Open the stream, go on after the last event, and read."""
        connection = socket.socket()
        if self.slow:
            connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _BUFFER)
        connection.setblocking(False)  # noqa: FBT003 - its only parameter
        loop = asyncio.get_running_loop()
        await loop.sock_connect(connection, ("127.0.0.1", self.stage.service.port))
        resumed = f"Last-Event-ID: {self.last}\r\n" if self.last else ""
        await loop.sock_sendall(
            connection,
            f"GET /api/v1/live?points=10 HTTP/1.1\r\nHost: 127.0.0.1\r\n{resumed}"
            f"Authorization: Bearer {self.stage.token}\r\n\r\n".encode(),
        )
        end = time.monotonic() + seconds
        with connection:
            while time.monotonic() < end:
                piece = await loop.sock_recv(connection, 2048 if self.slow else 65536)
                if not piece:
                    raise ConnectionError(self.pieces[-1:])
                self.pieces.append((time.time_ns(), piece))
                if self.slow:
                    await asyncio.sleep(len(piece) / self.slow)

    def understand(self) -> None:
        """Take the pieces apart, line by line; one stream's, whole or broken off."""
        rest = b""
        for now, piece in self.pieces:
            *lines, rest = (rest + piece).split(b"\n")
            for line in lines:
                self._take(line, now)
        self.pieces.clear()

    def _take(self, line: bytes, now: int) -> None:
        if line.startswith(b"id: "):
            self.begun = line[4:].decode()
        elif not line:
            self.last = self.begun
        elif line.startswith(b"data: ") and b'"resolution"' in line:
            told = json.loads(line[6:])
            first = parse_timestamp(told["t0"])
            width = told["dt"] if told["resolution"] == "hull" else _PERIOD
            until = first + told["t"][-1] + width
            self.events.append((int(self.begun), first, until, now, told["channel"]))


def measure_viewers(folder: Path, *, seconds: float) -> list[Row]:
    """Latency with 200 viewers, staleness of a slow one, holes of one that comes back."""
    folder.mkdir()
    with Stage(folder / "stage", live=_CHANNELS, block=_BLOCK) as stage:
        process = stage.service.process
        assert process is not None
        psutil.Process(process.pid).cpu_affinity([0])
        return asyncio.run(_measure(stage, seconds))


async def _measure(stage: Stage, seconds: float) -> list[Row]:
    viewers = [Viewer(stage) for _ in range(_VIEWERS)]
    slow, returning = Viewer(stage, slow=_SLOW_BYTES), Viewer(stage)
    begun, spent = time.monotonic(), cpu_seconds(stage.service)
    await asyncio.gather(
        *(viewer.look(seconds) for viewer in viewers),
        slow.look(seconds),
        _return(returning, seconds),
    )
    share = (cpu_seconds(stage.service) - spent) / (time.monotonic() - begun) * 100
    for viewer in (*viewers, slow):
        viewer.understand()
    return [
        *_of_all(viewers),
        Row(f"live, {_VIEWERS} viewers: processor of the cloud", share, "%"),
        *_of_slow(slow),
        *_of_returning(returning),
    ]


async def _return(viewer: Viewer, seconds: float) -> None:
    """Break off and come back again and again."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        await viewer.look(1.0)
        viewer.understand()
        await asyncio.sleep(0.5)


def _of_all(viewers: list[Viewer]) -> Iterator[Row]:
    name = f"live, {_VIEWERS} viewers at once"
    ages = np.concatenate([[now - until for *_, until, now, _ in one.events] for one in viewers])
    yield at_most(f"{name}: holes in time", sum(map(_breaks, viewers)), "", 0)
    for q, most in ((50, 100.0), (99, 250.0)):
        age = float(np.percentile(ages, q)) / 1e6
        yield at_most(f"{name}, block's last sample to event, p{q}", age, "ms", most)


def _of_slow(viewer: Viewer) -> Iterator[Row]:
    name = f"live, a viewer of {_SLOW_BYTES / 1e3:g} kB/s"
    settled = viewer.events[len(viewer.events) // 3 :]
    ages = [(now - until) / 1e6 for *_, until, now, _ in settled]
    widths = [(until - first) / 1e6 for _, first, until, *_ in settled]
    yield Row(f"{name}: age of what it is told, p50", float(np.median(ages)), "ms")
    yield Row(f"{name}: age of what it is told, largest", max(ages), "ms")
    yield Row(f"{name}: width of an event, p50", float(np.median(widths)), "ms")
    holes = _breaks(viewer)
    yield at_most(f"{name}: holes in time", holes, "", 0)


def _of_returning(viewer: Viewer) -> Iterator[Row]:
    name = "live, a viewer that resumes by Last-Event-ID: holes in time"
    yield at_most(name, _breaks(viewer), "", 0)


def _breaks(viewer: Viewer) -> int:
    """How often a channel's next event begins later than the one before ended."""
    ends: dict[str, int] = {}
    found = 0
    for _, first, until, _, channel in viewer.events:
        found += first > ends.get(channel, first) + _PERIOD // 2
        ends[channel] = max(until, ends.get(channel, 0))
    return found


def main() -> None:
    """Measure, and say so line by line."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.viewers", description=__doc__)
    parser.add_argument("--seconds", type=float, default=20.0)
    options: Any = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="eskin-viewers-") as folder:
        rows = measure_viewers(Path(folder) / "viewers", seconds=options.seconds)
    for row in rows:
        met = "" if row.met is None else " (met)" if row.met else " (NOT met)"
        print(f"{row.name}: {row.value:.4g} {row.unit}{met}")


if __name__ == "__main__":
    main()
