"""A skin with a biometric page, and a twin of it whose channels are public."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from eskin.interval import Interval, Verdict
from eskin.wire.frames import Frame, Grid, Layout, Patch, PatchSamples, Peak, Privacy, Statements
from eskin.wire.messages import Position
from eskin.wire.timestamp import SECOND
from tests.unit.cloud.clouds import batch
from tests.unit.cloud.messages import START
from tests.unit.cloud.sealing import NODE
from tests.unit.cloud.skins import PALM, describe, layout

if TYPE_CHECKING:
    from eskin_cloud.store import Store

    from tests.unit.cloud.clouds import Stand
    from tests.unit.cloud.sealing import Site

TWIN: Final = "twin"
CHANNEL: Final = "h1.bioelectric"
PUBLIC_CHANNEL: Final = "h1.voltage"
TAXELS: Final = ("h0", "h1", "h2")
LEAST_WIDTH: Final = 2.0**-20
STRIDES: Final = bytes((0, 0, 2))
SKEW: Final = (0, 1_000_000, 90 * SECOND)
GRID: Final = Grid(delay=1000, period=10_000_000, first_row=3, rows=20, coverage=0.999)
HEART: Final = Patch(
    "heart", "bioelectric", "V", TAXELS, LEAST_WIDTH, Privacy.BIOMETRIC, "wearer", skew=SKEW
)
OPEN_HEART: Final = Patch("heart", "voltage", "V", TAXELS, LEAST_WIDTH, skew=SKEW)
WORN: Final = layout((PALM, HEART), (1, 1))
OPEN_WORN: Final = layout((PALM, OPEN_HEART), (1, 1))


def worn(sequence: int, *, of: Layout = WORN, at: int | None = None, page: int = 1) -> Frame:
    """A frame of a page: of any samples, that of the heart by default.

    Args:
        sequence: Its number, which gives the samples, too.
        of: The layout.
        at: When, ns after `START`; else frames follow each other.
        page: The page.
    """
    first = START + (sequence * GRID.rows * GRID.period if at is None else at)
    lo = np.random.default_rng(sequence).normal(size=(GRID.rows, 3))
    packed = PatchSamples.pack(
        Interval(lo, lo + 0.25), LEAST_WIDTH if page else 64.0, patch=page, grid=0,
        first_row=GRID.first_row, strides=STRIDES,
    )  # fmt: skip
    instant = first, first + 4000
    position = Position(1, sequence)
    return Frame(position, of.content_hash, page, sequence, instant, (GRID,), (packed,))


def beats(sequence: int, count: int = 2, *, of: Layout = WORN) -> Statements:
    """Peaks of the heart, all at one time."""
    time = START + sequence * 1000, START + sequence * 1000 + 9
    peaks = tuple(
        Peak(1, k % 3, time, Verdict.CERTAIN, (1, 1), (1.0 + k, 2.0 + k), (0.5, 9.0), 0.99)
        for k in range(count)
    )
    return Statements(Position(1, sequence), of.content_hash, peaks)


def describe_worn(store: Store) -> None:
    """Describe the skin and its twin."""
    describe(store, WORN, PALM, HEART, node=NODE)
    describe(store, OPEN_WORN, PALM, OPEN_HEART, node=TWIN)


async def bring_both(stand: Stand, site: Site, *sequences: int) -> None:
    """Bring frames of the heart sealed, and those of the twin."""
    describe_worn(stand.cloud.store)
    stored = await stand.ingest(site.batch(*map(worn, sequences)))
    assert {item["result"] for item in stored.json()["items"]} == {"stored"}
    of_twin = [worn(sequence, of=OPEN_WORN) for sequence in sequences]
    stored = await stand.ingest(batch(*of_twin, node=TWIN))
    assert {item["result"] for item in stored.json()["items"]} == {"stored"}
