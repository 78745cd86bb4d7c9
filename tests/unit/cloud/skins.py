"""Small skins: layouts with patches, frames and statements that fit them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from eskin_cloud.ingest.posted_descriptions import read_posted, store_posted
from eskin_cloud.store.write.parsed_message import ParsedMessage

from eskin.interval import Interval, Verdict
from eskin.wire.frames import Frame, Gap, Grid, Layout, Patch, PatchSamples, Peak, Statements
from eskin.wire.messages import Position
from tests.support.identities import SITE
from tests.unit.cloud.clouds import admit, batch, put_items
from tests.unit.cloud.messages import NODE, START

if TYPE_CHECKING:
    from collections.abc import Sequence

    from eskin_cloud.ingest.posted_descriptions import PostedResult
    from eskin_cloud.store import Store
    from eskin_cloud.store.write.ingest import IngestResult

    from tests.unit.cloud.clouds import Said


def patch(
    patch_id: str, columns: int, *, quantity: str = "pressure", unit: str = "Pa", **rest: object
) -> Patch:
    """A patch whose taxels are named by its id."""
    taxels = tuple(f"{patch_id}-{column}" for column in range(columns))
    return Patch(patch_id, quantity, unit, taxels, 64.0, **rest)  # type: ignore[arg-type]  # of a Patch


PALM = patch("palm", 3, skew=(0, 2000, 4000), alpha=((0.99, 1.01),), beta=((-5.0, 5.0),))
WARM = patch("warm", 1, quantity="temperature", unit="Cel")
TIP = patch("tip", 2)
PATCHES = (PALM, WARM, TIP)


def layout(patches: Sequence[Patch] = PATCHES, pages: tuple[int, ...] = (2, 1)) -> Layout:
    """A layout of patches."""
    return Layout(tuple(each.content_hash for each in patches), pages)


HAND = layout()
FAST = Grid(delay=1000, period=4_000_000, first_row=750, rows=5, coverage=1.0)
SLOW = Grid(delay=8_000_000, period=20_000_000, first_row=150, rows=1, coverage=0.999)


def samples(rows: int, columns: int, seed: int = 0) -> Interval:
    """Any samples."""
    lo = np.random.default_rng(seed).normal(1000.0, 100.0, (rows, columns))
    return Interval(lo, lo + 64.0)


def frame(
    sequence: int, *, boot: int = 1, page: int = 0, of: Layout = HAND, seed: int = 0, at: int = 0
) -> Frame:
    """A frame of a page of `HAND`, or of a layout that has the same sizes."""
    of_patches = [(0, PALM, FAST, 2), (1, WARM, SLOW, 0)] if page == 0 else [(2, TIP, FAST, 0)]
    grids = tuple(grid for _, _, grid, _ in of_patches)
    packed = tuple(
        PatchSamples.pack(
            samples(grid.rows, len(each.taxels), seed),
            each.least_width,
            patch=number,
            grid=grids.index(grid),
            first_row=grid.first_row,
            epoch=epoch,
        )
        for number, each, grid, epoch in of_patches
    )
    first = START + at
    return Frame(
        Position(boot, sequence), of.content_hash, page, at, (first, first + 4000), grids, packed
    )


def statements(sequence: int, *, boot: int = 1, of: Layout = HAND, seed: int = 0) -> Statements:
    """A peak and a gap."""
    peak = Peak(
        0, 1, (START, START + 9), Verdict.CERTAIN, (1, 1), (float(seed), 1e6), (0.5, 9.0), 0.999
    )
    gap = Gap("flash full", (START, START + 1), 7, 1750, ((0, 3, 9),), (0, 2))
    return Statements(Position(boot, sequence), of.content_hash, (peak,), gaps=(gap,))


def describe(
    store: Store, *descriptions: Said, node: str = NODE, site: str = SITE
) -> list[PostedResult]:
    """Present descriptions as a gateway does."""
    admit(store, node)
    posted = read_posted(batch(*descriptions, node=node))
    return store.write_node(
        node, lambda connection, cache: store_posted(connection, cache, posted, site=site)
    ).result(120)


def bring_all(store: Store, *said: tuple[str, Said]) -> IngestResult:
    """Store messages of nodes in one batch, as ingest does."""
    items = [ParsedMessage.parse(node, message.encode()) for node, message in said]
    return put_items(store, items, described=True)
