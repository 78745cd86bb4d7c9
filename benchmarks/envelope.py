"""Cost of sealing and opening a block, and of writing and reading it."""

from __future__ import annotations

import tempfile
import time
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.report import Row
from eskin.interval import Interval
from eskin.tube import Tube
from eskin.wire.envelope import Opener, Sealer
from eskin.wire.messages import Block, Encoding, Position, decode_message
from tests.support.identities import Identities

if TYPE_CHECKING:
    from collections.abc import Callable

_TOPIC = "eskin/v1/nodes/fingertip/blocks"
_ROUNDS = 7
_CALLS = 300


def measure_envelope() -> list[Row]:
    """Microseconds a block of 250 samples in q16."""
    with tempfile.TemporaryDirectory() as folder:
        identities = Identities(Path(folder))
        node, site = identities.node, identities.site
        sealer = Sealer(node, site.certificate)
        opener = Opener([site], sender={node.thumbprint: node.certificate}.get)
        tube = _tube(250)
        block = Block.pack(Position(1, 2), "t01.capacitance", 0, tube, Encoding.Q16)
        data = block.encode()
        envelope = sealer.seal(data, topic=_TOPIC, held=Position(1, 0))
        return [
            _row("pack a block", lambda: Block.pack(
                Position(1, 2), "t01.capacitance", 0, tube, Encoding.Q16)),
            _row("seal a block", lambda: sealer.seal(data, topic=_TOPIC, held=Position(1, 0))),
            _row("open a block", lambda: opener.open(envelope, topic=_TOPIC)),
            _row("decode a block", lambda: decode_message(data)),
        ]  # fmt: skip


def _tube(n: int) -> Tube:
    values = 5e-11 * (1.1 + np.sin(np.linspace(0.0, 6.0, n)))
    return Tube((0, 4_000_000), 1_000_000, Interval.relative(values, 0.01), "F", 1.0)


def _row(name: str, call: Callable[[], object]) -> Row:
    times = []
    for _ in range(_ROUNDS):
        start = time.perf_counter()
        for _ in range(_CALLS):
            call()
        times.append((time.perf_counter() - start) / _CALLS)
    return Row(f"{name} of 250 samples", median(times) * 1e6, "us")
