"""Cost of sealing and opening a frame, and of writing and reading it."""

from __future__ import annotations

import tempfile
import time
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING

from benchmarks.report import Row
from benchmarks.said import FEW, START, frame
from eskin.wire.envelope import Opener, Sealer
from eskin.wire.frames import EncodedFrame
from eskin.wire.messages import Position
from tests.support.identities import Identities

if TYPE_CHECKING:
    from collections.abc import Callable

_TOPIC = "eskin/v1/nodes/fingertip/frames"
_ROUNDS = 7
_CALLS = 300


def measure_envelope() -> list[Row]:
    """Microseconds a frame of four channels."""
    with tempfile.TemporaryDirectory() as folder:
        identities = Identities(Path(folder))
        node, site = identities.node, identities.site
        sealer = Sealer(node, site.certificate)
        opener = Opener([site], sender={node.thumbprint: node.certificate}.get)
        data = frame(FEW, Position(1, 2), START)
        envelope = sealer.seal(data, topic=_TOPIC, held=Position(1, 0))
        return [
            _row("seal a frame", lambda: sealer.seal(data, topic=_TOPIC, held=Position(1, 0))),
            _row("open a frame", lambda: opener.open(envelope, topic=_TOPIC)),
            _row("read a frame and check it", lambda: EncodedFrame.decode(data)),
        ]


def _row(name: str, call: Callable[[], object]) -> Row:
    times = []
    for _ in range(_ROUNDS):
        start = time.perf_counter()
        for _ in range(_CALLS):
            call()
        times.append((time.perf_counter() - start) / _CALLS)
    return Row(f"{name} of {FEW.samples} samples", median(times) * 1e6, "us")
