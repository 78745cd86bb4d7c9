"""One good message of each kind, with every field that it may have."""

from __future__ import annotations

import math
from dataclasses import fields, replace

import numpy as np

from eskin.interval import Interval, Verdict
from eskin.wire.frames import (
    Because,
    ClosedLine,
    Contact,
    Controller,
    Frame,
    Gap,
    Grid,
    Layout,
    Link,
    MonitorVerdict,
    Patch,
    PatchSamples,
    Peak,
    Privacy,
    Seam,
    Statements,
)
from eskin.wire.frames.frame import FrameHead
from eskin.wire.messages import Position

INF = math.inf
PALM = Patch(
    patch_id="palm",
    quantity="pressure",
    unit="Pa",
    taxels=("t00", "t01", "t02"),
    least_width=64.0,
    positions=((0, 4000, 8000), (0, 0, -5), (7, 7, 7)),
    neighbours=((0, 1), (1, 2)),
    skew=(0, 2000, 4000),
    alpha=((0.99, 1.01),),
    beta=((-5.0, 5.0), (-6.0, 5.0), (-5.0, 5.0)),
    slew=1e6,
    threshold=3e3,
    cell_area=4e-4,
)
AIR = Patch("air", "temperature", "Cel", ("a01",), 0.5)
WEARER = Patch("skin", "bioelectric", "V", ("b01",), 1e-5, Privacy.BIOMETRIC, "wearer")
PATCHES = (PALM, AIR, WEARER)
TRIANGLE = ClosedLine((-5000, 9000, 4000), (0, -100, 7000))
LAYOUT = Layout(
    patches=tuple(patch.content_hash for patch in PATCHES),
    pages=(2, 1),
    seams=(Seam(0, 1, ((2, 0),)),),
    controllers=(Controller("hand-1", 1), Controller("hand-2", 1)),
)
FAST = Grid(delay=0, period=4_000_000, first_row=750, rows=3, coverage=1.0)
SLOW = Grid(delay=8_000_000, period=20_000_000, first_row=150, rows=1, coverage=0.999)
PRESSED = Interval(
    np.array([[100.0, 200.0, -INF], [101.5, -INF, 50.0], [90.0, 210.25, -INF]]),
    np.array([[164.0, 300.0, INF], [170.0, INF, INF], [160.0, 290.0, 700.0]]),
)
WARM = Interval(np.array([[20.25]]), np.array([[20.875]]))
FRAME = Frame(
    position=Position(3, 17),
    layout=LAYOUT.content_hash,
    page=0,
    ticks=3_000_000_000,
    time=(1_790_000_003_000_000_000, 1_790_000_003_000_004_000),
    grids=(FAST, SLOW),
    patches=(
        PatchSamples.pack(
            PRESSED, PALM.least_width, patch=0, grid=0, first_row=FAST.first_row, epoch=2,
            strides=bytes((0, 1, 0)), unshared=(2,),
        ),
        PatchSamples.pack(WARM, AIR.least_width, patch=1, grid=1, first_row=SLOW.first_row),
    ),
)  # fmt: skip
STATEMENTS = Statements(
    position=Position(3, 18),
    layout=LAYOUT.content_hash,
    peaks=(Peak(0, 1, (5, 9), Verdict.CERTAIN, (1, 1), (1.0, 1.5), (0.5, INF), 0.999),),
    contacts=(
        Contact(
            7, (5, 6), Verdict.CERTAIN, (1, 2), (1, 3), (0.5, 1.5), ((0.0, 0.01),
            (-0.25, 0.5)), 0.99,
            (Link(6, Verdict.POSSIBLE),),
        ),
        Contact(8, (5, 6), Verdict.POSSIBLE, (0, 1), (0, 1), (0.0, INF), ((0.0, 1.0),) * 3, 1.0),
    ),
    verdicts=(
        MonitorVerdict("grip",
        (5, 6), Verdict.POSSIBLE, final=False, because=Because.GAP | Because.WIDTH, coverage=1.0),
        MonitorVerdict("slip",
        (5, 6), Verdict.IMPOSSIBLE, final=True, because=Because(0), coverage=0.5),
    ),
    gaps=(Gap("flash full", (1, 2), 7, 1750, ((1, 0, 6), (2, 1, 1)), (0, 2)),),
)  # fmt: skip
SMALL = (
    WEARER,
    AIR,
    replace(LAYOUT, seams=(), controllers=(), outline=(TRIANGLE,)),
    replace(FRAME, grids=FRAME.grids[1:], patches=(replace(FRAME.patches[1], grid=0),)),
    replace(STATEMENTS, peaks=(), contacts=(), verdicts=()),
)
MESSAGES = (PALM, LAYOUT, FRAME, STATEMENTS, *SMALL)


def head_fields(head: FrameHead) -> tuple[object, ...]:
    """The values of a head, also of one that is part of a frame or of a summary."""
    return tuple(getattr(head, each.name) for each in fields(FrameHead))
