"""CPU of a gateway a frame, without network: `python -m benchmarks.gateway_frames`.

A frame has 30 patches x 64 columns x 5 rows: a page of a hand of 8,400 taxels at 50 Hz, 100 ms. It
is opened, checked, committed, acknowledged, and its public hulls are made.
"""

from __future__ import annotations

import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np

from benchmarks.report import Row
from eskin.wire.frames import EncodedFrame, Frame
from eskin.wire.frames.column_hulls import ColumnHulls
from eskin.wire.frames.warm_up import warm_up
from eskin.wire.topics import Stream
from tests.support.identities import Identities
from tests.unit.gateway.in_memory import Inside
from tests.unit.gateway.messages import status
from tests.unit.gateway.skins import SkinOf, patch
from tests.unit.gateway.wire_node import Seal

if TYPE_CHECKING:
    from collections.abc import Callable

_PAGES: Final = (30, 30, 30, 30, 11)
_FRAMES: Final = 200
_GROUPS: Final = (1, 4, 16)
_INTERVAL_S: Final = 0.1 / 4.4
"""From frame to frame of all pages."""


def _milliseconds(work: Callable[[], object], count: int) -> float:
    begun = time.process_time()
    for _ in range(count):
        work()
    return (time.process_time() - begun) / count * 1e3


def _frames(skin: SkinOf) -> list[bytes]:
    """Frames of the first page, whose noise is a fifth of their width."""
    random = np.random.default_rng(1)
    base = 1000 + 50.0 * random.integers(0, 100, (_PAGES[0], 64))
    return [
        skin.frame(
            sequence, {k: base[k] + random.normal(0, 10, (5, 64)) for k in range(_PAGES[0])}
        ).encode()
        for sequence in range(1, _FRAMES + 1)
    ]


def _gateway(folder: Path, frames: list[bytes], skin: SkinOf, group: int) -> float:
    """Milliseconds a frame, with so many frames in a commit."""
    identities = Identities(folder / "identities")
    inside, seal = Inside(folder, identities), Seal(identities.node, identities.site)
    introduction = seal("fingertip", Stream.STATUS, status(0).encode(), introduce=True)
    inside.arrive(Stream.STATUS, introduction)
    for each in skin.descriptions:
        inside.arrive(Stream.LAYOUTS, seal("fingertip", Stream.LAYOUTS, each))
    received = [
        inside.received_message(Stream.FRAMES, seal("fingertip", Stream.FRAMES, each))
        for each in frames
    ]
    inside.commit_loop.process(received[:1])  # what is loaded once
    begun = time.process_time()
    for first in range(1, len(received), group):
        inside.clock.seconds += group * _INTERVAL_S
        inside.commit_loop.process(received[first : first + group])
    used = time.process_time() - begun
    assert inside.spool.statistics.messages == len(frames) + 1
    inside.spool.close()
    return used / (len(received) - 1) * 1e3


def measure_gateway_frames() -> list[Row]:
    """CPU of a gateway a frame of 1,920 channels, by frames in a commit."""
    warm_up()
    skin, rows = _skin(), []
    frames = _frames(skin)
    for group in _GROUPS:
        with tempfile.TemporaryDirectory() as folder:
            used = _gateway(Path(folder), frames, skin, group)
        rows.append(Row(f"CPU of the gateway a frame of a skin, {group} a commit", used, "ms"))
    return rows


def _skin() -> SkinOf:
    return SkinOf(*(patch(number, 64) for number in range(sum(_PAGES))), pages=_PAGES)


def main() -> None:
    """Measure, and print."""
    warm_up()
    skin = _skin()
    frames = _frames(skin)
    data = frames[0]
    summary = EncodedFrame.decode(data)
    ColumnHulls.of(summary)
    print(f"frame: {np.mean([len(each) for each in frames]):.0f} bytes")
    for name, work in (
        ("Frame.decode", lambda: Frame.decode(data)),
        ("EncodedFrame.decode", lambda: EncodedFrame.decode(data)),
        ("ColumnHulls.of", lambda: ColumnHulls.of(summary)),
    ):
        print(f"{name}: {_milliseconds(work, _FRAMES):.2f} ms")
    for group in _GROUPS:
        with tempfile.TemporaryDirectory() as folder:
            used = _gateway(Path(folder), frames, skin, group)
        print(f"gateway, {group} frames a commit: {used:.2f} ms a frame")


if __name__ == "__main__":
    main()
