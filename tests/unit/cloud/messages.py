"""Messages as nodes would say them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import cbor2
import numpy as np

from eskin.interval import Interval, Verdict
from eskin.tube import Tube
from eskin.wire.messages import Block, ChannelInfo, Encoding, Gap, Peak, Position, Status
from eskin.wire.messages.cbor_map import dump

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

NODE: Final = "fingertip"
CHANNEL: Final = "t01.capacitance"
START: Final = 1_800_000_000_000_000_000
DT: Final = 1_000_000


def block(
    sequence: int,
    lo: ArrayLike = (1.0,),
    hi: ArrayLike = (2.0,),
    *,
    boot: int = 1,
    time: tuple[int, int] = (START, START),
    dt: int = DT,
    channel: str = CHANNEL,
    unit: str = "F",
    coverage: float = 1.0,
    encoding: Encoding = Encoding.F64,
) -> Block:
    """A block."""
    values = Interval(np.asarray(lo, np.float64), np.asarray(hi, np.float64))
    tube = Tube(time, dt, values, unit, coverage)
    return Block.pack(Position(boot, sequence), channel, 0, tube, encoding)


def lying(said: Block) -> bytes:
    """A block's bytes with a greater upper bound than its samples have."""
    lo, hi = said.bounds
    return dump({**cbor2.loads(said.encode()), 14: [lo, hi + 1.0]})


def peak(
    sequence: int,
    *,
    boot: int = 1,
    time: tuple[int, int] = (START, START + 5 * DT),
    verdict: Verdict = Verdict.CERTAIN,
    channel: str = CHANNEL,
    unit: str = "F",
) -> Peak:
    """A peak."""
    return Peak(
        Position(boot, sequence),
        channel,
        unit,
        time,
        verdict,
        (1, 1),
        (2.0, float("inf")),
        (0.5, 0.75),
        0.875,
    )


def gap(sequence: int, *, boot: int = 1, time: tuple[int, int] = (START, START + DT)) -> Gap:
    """A gap."""
    return Gap(Position(boot, sequence), "flash full", time, 3, 1500, ((boot, 0, 2),))


def status(
    sequence: int, *, boot: int = 1, unit: str = "F", channels: tuple[str, ...] = (CHANNEL,)
) -> Status:
    """A status."""
    return Status(
        Position(boot, sequence),
        (START, START + 10),
        "fingertip",
        "one finger",
        5 * 10**9,
        2,
        4096,
        1_048_576,
        1,
        tuple(ChannelInfo(name, unit, DT, 1.0) for name in channels),
    )
