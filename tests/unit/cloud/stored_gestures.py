"""Small skins with a known truth that one node samples: as it states them, and as they are known.

The node samples rows each 80 ms, columns up to 40 ms later than their row and some of them in each
2nd or 4th row only. Its frames state their times within some ms, and some are lost.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
from eskin_cloud.query.contacts import ContactSkin

from eskin.gestures import Templates
from eskin.interval import Interval
from eskin.wire.frames import DescribedLayout, Frame, Grid, Layout, Patch, PatchSamples, Seam
from eskin.wire.messages import Position
from tests.unit.cloud.messages import START
from tests.unit.eskin.gestures.oracle import Truth
from tests.unit.eskin.gestures.worlds import THRESHOLD, World, draw_world

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from eskin.contacts import Skin

    Sets = Sequence[frozenset[int]]
    Spans = list[tuple[int, int]]

MILLI: Final = 1_000_000
PERIOD: Final = 80 * MILLI
"""So that the default templates are to it what those of `worlds` are to 10 ns."""
PITCH_UM: Final = 7500
JITTER: Final = 5 * MILLI
HIGHER: Final = 3.0
"""A patch's threshold is so many times that of the patch before."""


@dataclass(frozen=True)
class StoredWorld(World):
    """A truth with the default templates."""

    def truth(self) -> Truth:
        """What the oracle says."""
        return Truth(self.skin, self.instants, self.pressed, Templates())


@dataclass(frozen=True)
class Record:
    """What a node states, and what is true of it.

    Attributes:
        layout: What it states.
        patches: Its patches, a page each.
        frames: Its frames.
        world: The truth, and what these frames say of it.
    """

    layout: Layout
    patches: tuple[Patch, ...]
    frames: list[Frame]
    world: StoredWorld


def make_layout(
    skin: Skin, sizes: Sequence[int], skew: Sequence[int]
) -> tuple[Layout, list[Patch]]:
    """A layout of a skin with a pitch of 1: patches of so many taxels, a page each."""
    owner = np.repeat(np.arange(len(sizes)), sizes)
    begins = np.cumsum([0, *sizes])
    inside: dict[tuple[int, int], list[tuple[int, int]]] = {}
    rows = np.repeat(np.arange(len(skin)), np.diff(skin.starts))
    for a, b in sorted(zip(rows.tolist(), skin.neighbours.tolist(), strict=True)):
        if a < b:
            key = int(owner[a]), int(owner[b])
            inside.setdefault(key, []).append((a - int(begins[key[0]]), b - int(begins[key[1]])))
    axes = np.rint(skin.positions * PITCH_UM).astype(int).T
    patches = []
    for k, size in enumerate(sizes):
        own = slice(int(begins[k]), int(begins[k]) + size)
        patches.append(
            Patch(
                f"p{k}", "pressure", "Pa", tuple(f"t{n:02d}" for n in range(own.start, own.stop)),
                64.0, neighbours=tuple(inside.get((k, k), ())), threshold=HIGHER**k * THRESHOLD,
                cell_area=(k + 1) * 4e-6, positions=tuple(map(tuple, axes[:, own].tolist())),
                skew=tuple(skew[own]) if any(skew[own]) else (),
            )
        )  # fmt: skip
    seams = [Seam(*key, tuple(found)) for key, found in sorted(inside.items()) if len({*key}) > 1]
    hashes = tuple(each.content_hash for each in patches)
    return Layout(hashes, (1,) * len(sizes), tuple(seams)), patches


def draw_record(random: np.random.Generator, *, whole: bool = False) -> Record:
    """A random truth, sampled and stated more or less well.

    Args:
        random: Draws it.
        whole: Whether all taxels are sampled in each row at once, and no frame is lost.
    """
    drawn = draw_world(random, known=whole)
    pressed, size = drawn.pressed, len(drawn.skin)
    rare = not whole and random.random() < 0.3
    skew = np.zeros(size, int)
    if not whole and random.random() < 0.6:
        skew = random.integers(0, 41, size) * MILLI
    sizes = _draw_sizes(random, drawn.skin)
    layout, patches = make_layout(drawn.skin, sizes, skew.tolist())
    skin = ContactSkin.of(DescribedLayout.of(layout, patches))
    assert skin is not None
    strides = np.zeros(size, int)
    if rare:
        strides = random.choice([0, 1, 2], size, p=[0.8, 0.1, 0.1]) + int(random.integers(0, 2))
    doubt = 0.0 if whole else float(random.choice([0.0, 0.0, 0.02, 0.2]))
    jitter = random.integers(-JITTER, JITTER + 1, len(pressed))
    bases = START + PERIOD * np.arange(len(pressed)) + jitter
    times = bases + random.integers(int(skew.min()), int(skew.max()) + 1, len(pressed))
    shape = len(pressed), size
    true = np.zeros(shape, np.bool_)
    for k, each in enumerate(pressed):
        true[k, sorted(each)] = True
    vague = random.random(shape) < doubt
    sampled = np.arange(len(pressed))[:, np.newaxis] % (1 << strides) == 0
    known = np.zeros(shape, np.bool_)
    sent = np.zeros((len(pressed), len(sizes)), np.bool_)
    frames: list[Frame] = []
    lost = 0.0 if whole else float(random.choice([0.0, 0.15, 0.3]))
    begins = np.cumsum([0, *sizes])
    for rows, boot, ticks in _stretches(random, len(pressed), restarts=not whole):
        early, late = (int(each) * MILLI for each in random.integers(0, 31, 2))
        for page, columns in enumerate(sizes):
            own = slice(int(begins[page]), int(begins[page]) + columns)
            if random.random() < lost or not sampled[rows, own].any():
                continue
            known[rows, own] = sampled[rows, own]
            sent[rows, page] = True
            lo = np.where(true[rows, own] & ~vague[rows, own], 1500.0, 0.0)
            hi = np.where(true[rows, own] | vague[rows, own], 2000.0, 500.0)
            values = Interval(HIGHER**page * lo, HIGHER**page * hi)
            first, count = rows.start, rows.stop - rows.start
            packed = PatchSamples.pack(
                values, 64.0, patch=page, grid=0, first_row=first,
                strides=bytes(strides[own].tolist()) if strides[own].any() else b"",
            )  # fmt: skip
            grid = Grid(0, PERIOD, first, count, 1.0)
            stated = START + PERIOD * first
            time = stated - JITTER - early, stated + JITTER + late
            position = Position(boot, len(frames))
            frames.append(
                Frame(position, layout.content_hash, page, ticks, time, (grid,), (packed,))
            )
    # Rows at which nothing was sampled, as all frames say, are no instants.
    instants = np.flatnonzero(sampled.any(axis=1) | ~sent.all(axis=1))
    held = np.flatnonzero(sent[instants].any(axis=1))
    inside = instants[held[0] : held[-1] + 1] if held.size else instants[:0]
    certain, possible = true & known & ~vague, true | vague | ~known
    world = StoredWorld(
        skin.skin,
        times[instants].tolist(),
        [pressed[k] for k in instants],
        int(held[0]) if held.size else 0,
        [frozenset(np.flatnonzero(row).tolist()) for row in certain[inside]],
        [frozenset(np.flatnonzero(row).tolist()) for row in possible[inside]],
        [(int(instant), int(instant)) for instant in times[inside]],
    )
    return Record(layout, tuple(patches), frames, world)


def _draw_sizes(random: np.random.Generator, skin: Skin) -> list[int]:
    """How many taxels a skin's patches have: all in one, or some rows in the first of two."""
    size, columns = len(skin), int(skin.positions[:, 0].max()) + 1
    cut = columns * int(random.integers(1, size // columns)) if size > columns else 0
    return [size] if not cut or random.random() < 0.4 else [cut, size - cut]


def _stretches(
    random: np.random.Generator, count: int, *, restarts: bool
) -> Iterator[tuple[slice, int, int]]:
    """Rows of neighbouring frames, the node's start, and its clock.

    It loses rows where it starts again, and its clock goes on as if they had not been.
    """
    at, boot, ticks = 0, 1, 0
    while at < count:
        end = min(at + int(random.integers(1, 6)), count)
        if restarts and random.random() < 0.1:
            boot += 1
        else:
            yield slice(at, end), boot, ticks
            ticks += (end - at) * PERIOD
        at = end
