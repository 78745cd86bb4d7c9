"""Messages of a node for the gateway's tests."""

from __future__ import annotations

import numpy as np

from eskin.interval import Interval, Verdict
from eskin.wire import frames
from eskin.wire.frames import Frame, Grid, Layout, Patch, PatchSamples, Statements
from eskin.wire.messages import Outcome, Position, Result, Status

EPOCH = 1_790_000_000 * 10**9
CHANNEL = "t01.capacitance"


PATCH = Patch("tip", "capacitance", "F", ("t01",), 2e-14)
LAYOUT = Layout((PATCH.content_hash,), (1,))
DESCRIPTIONS = PATCH, LAYOUT
"""The skin of the fingertip: one channel."""


def frame(sequence: int, *, boot: int = 1, n: int = 100) -> Frame:
    """A frame of a wave, n samples at 1 ms."""
    start = EPOCH + sequence * n * 10**6
    wave = 1e-11 + 1e-12 * np.sin(np.arange(n) / 10.0 + sequence)
    samples = PatchSamples.pack(
        Interval(wave - 1e-14, wave + 1e-14).reshape(-1, 1), PATCH.least_width,
        patch=0, grid=0, first_row=sequence * n,
    )  # fmt: skip
    return Frame(
        Position(boot, sequence), LAYOUT.content_hash, 0, sequence * n * 10**6,
        (start, start + 500), (Grid(0, 10**6, sequence * n, n, 1.0),), (samples,),
    )  # fmt: skip


def peak(sequence: int, *, boot: int = 1) -> Statements:
    """A possible peak of unbounded height."""
    found = frames.Peak(
        0, 0, (EPOCH, EPOCH + 7), Verdict.POSSIBLE, (0, 2), (1e-11, np.inf), (0.0, np.inf), 0.999
    )
    return Statements(Position(boot, sequence), LAYOUT.content_hash, peaks=(found,))


def gap(sequence: int, *, boot: int = 1) -> Statements:
    """A full flash gave up two messages."""
    lost = frames.Gap("flash full", (EPOCH, EPOCH + 9), 2, 200, ((boot, 0, 1),))
    return Statements(Position(boot, sequence), LAYOUT.content_hash, gaps=(lost,))


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
    )


def result(sequence: int, command: int, *, boot: int = 1) -> Result:
    """A command that was done."""
    place = Position(boot, sequence)
    return Result(place, (EPOCH, EPOCH + 9), command, Outcome.DONE, None, {"t01": {"rate": 5.0}})
