"""Messages of a node for the gateway's tests."""

from __future__ import annotations

import numpy as np

from eskin.interval import Interval, Verdict
from eskin.tube import Tube
from eskin.wire.messages import (
    Block,
    ChannelInfo,
    Encoding,
    Gap,
    Outcome,
    Peak,
    Position,
    Result,
    Status,
)

EPOCH = 1_790_000_000 * 10**9
CHANNEL = "t01.capacitance"


def block(
    sequence: int,
    *,
    boot: int = 1,
    n: int = 100,
    coverage: float = 1.0,
    channel: str = CHANNEL,
) -> Block:
    """A block of a wave, n samples at 1 ms."""
    start = EPOCH + sequence * n * 10**6
    wave = 1e-11 + 1e-12 * np.sin(np.arange(n) / 10.0 + sequence)
    tube = Tube((start, start + 500), 10**6, Interval(wave - 1e-14, wave + 1e-14), "F", coverage)
    return Block.pack(Position(boot, sequence), channel, sequence * n * 10**6, tube, Encoding.F32)


def peak(sequence: int, *, boot: int = 1, channel: str = CHANNEL) -> Peak:
    """A possible peak of unbounded height."""
    return Peak(
        position=Position(boot, sequence),
        channel=channel,
        unit="F",
        time=(EPOCH, EPOCH + 7),
        verdict=Verdict.POSSIBLE,
        count=(1, 2),
        height=(1e-11, float("inf")),
        prominence=(0.0, float("inf")),
        coverage=0.999,
    )


def gap(sequence: int, *, boot: int = 1) -> Gap:
    """A full flash gave up two messages."""
    return Gap(Position(boot, sequence), "flash full", (EPOCH, EPOCH + 9), 2, 200, ((boot, 0, 1),))


def status(sequence: int, *, boot: int = 1, description: str = "a fingertip") -> Status:
    """A node that fares well."""
    return Status(
        position=Position(boot, sequence),
        time=(EPOCH, EPOCH + 10),
        profile="fingertip",
        description=description,
        uptime=10**9,
        messages=3,
        used=1200,
        capacity=10**6,
        gaps=0,
        channels=(ChannelInfo(CHANNEL, "F", 10**6, 1.0),),
    )


def result(sequence: int, command: int, *, boot: int = 1) -> Result:
    """A command that was done."""
    place = Position(boot, sequence)
    return Result(place, (EPOCH, EPOCH + 9), command, Outcome.DONE, None, {"t01": {"rate": 5.0}})
