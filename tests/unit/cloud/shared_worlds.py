"""Small skins that several nodes share, with a truth: true pressures at true instants.

A node's samples are taken at instants of its own clock, which is wrong by a constant that the node
does not know, within a bound that it states.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final

import numpy as np

from eskin.interval import Interval
from eskin.wire.frames import Controller, Frame, Grid, Layout, Patch, PatchSamples, Seam
from eskin.wire.messages import Position
from tests.unit.cloud.messages import START

if TYPE_CHECKING:
    from collections.abc import Iterator

    from eskin.interval import Floats

MILLI: Final = 1_000_000
THRESHOLD, AREA = 1000.0, 4e-6
SPAN: Final = 400 * MILLI
"""So long the nodes of a world sample, from about `START` on."""


@dataclass(frozen=True)
class Sample:
    """A sample: its true instant and value, and until when it is the one that holds."""

    t: int
    until: int
    value: float


@dataclass
class World:
    """A skin, its frames by node, and the true samples of each taxel.

    Attributes:
        layout: What all nodes state.
        patches: Its patches, one for each node.
        positions: Of all taxels, in m.
        edges: Pairs of neighbours, by the number of their taxel.
        frames: By node.
        samples: Of each taxel, in order of time.
    """

    layout: Layout
    patches: tuple[Patch, ...]
    positions: Floats
    edges: list[tuple[int, int]]
    frames: dict[str, list[Frame]] = field(default_factory=dict)
    samples: list[list[Sample]] = field(default_factory=list)

    @property
    def taxels(self) -> list[str]:
        """Their names, in the order of the patches."""
        return [taxel for patch in self.patches for taxel in patch.taxels]

    def value(self, taxel: int, t: int, unknown: float) -> float:
        """What is true of a taxel at a true instant; something else where no sample holds."""
        for sample in self.samples[taxel]:
            if sample.t <= t < sample.until:
                return sample.value
        return unknown


def make_world(seed: int) -> World:
    """A random world: 2 to 4 nodes, up to 12 taxels, clocks wrong by up to 5 ms."""
    random = np.random.default_rng(seed)
    nodes = [f"n{k}" for k in range(random.integers(2, 5))]
    sizes = random.integers(1, 4, len(nodes)).tolist()
    total, begins = sum(sizes), np.cumsum([0, *sizes]).tolist()
    positions = random.integers(0, 20_000, (2, total))
    pairs = [(a, b) for a in range(total) for b in range(a + 1, total)]
    # A path through all, and others.
    edges = sorted({(k, k + 1) for k in range(total - 1)}
                   | {pair for pair in pairs if random.random() < 0.15})  # fmt: skip
    owner = np.repeat(np.arange(len(nodes)), sizes)
    inside: dict[tuple[int, int], list[tuple[int, int]]] = {}
    for a, b in edges:
        first, second = int(owner[a]), int(owner[b])
        inside.setdefault((first, second), []).append((a - begins[first], b - begins[second]))
    patches = tuple(
        Patch(
            f"p{k}", "pressure", "Pa", tuple(f"t{n:02d}" for n in range(begins[k], begins[k + 1])),
            1.0, neighbours=tuple(inside.get((k, k), ())), threshold=THRESHOLD, cell_area=AREA,
            positions=tuple(tuple(axis) for axis in positions[:, begins[k]:begins[k + 1]].tolist()),
        )
        for k in range(len(nodes))
    )  # fmt: skip
    layout = Layout(
        tuple(each.content_hash for each in patches),
        (1,) * len(nodes),
        tuple(
            Seam(*key, tuple(found)) for key, found in sorted(inside.items()) if len(set(key)) > 1
        ),
        tuple(Controller(node, 1) for node in nodes),
    )
    world = World(layout, patches, positions.T / 1e6, edges)
    for number, node in enumerate(nodes):
        frames, samples = _sample(random, world, number)
        world.frames[node] = frames
        world.samples += samples
    return world


def _sample(
    random: np.random.Generator, world: World, number: int
) -> tuple[list[Frame], list[list[Sample]]]:
    """What a node says, and what is true of it: pressures jump, or swing."""
    columns, rows = len(world.patches[number].taxels), int(random.integers(2, 7))
    period = int(random.integers(10, 21)) * MILLI
    error = int(random.integers(0, 5 * MILLI + 1))
    wrong = int(random.integers(-error, error + 1))
    begin = START + int(random.integers(0, period))
    hertz, phase = random.uniform(1, 25, columns), random.uniform(0, 6, columns)
    height = random.choice([0.0, 600.0, 1500.0], columns)
    lost = set(random.integers(0, 12, 1).tolist()) if random.random() < 0.5 else set()
    frames: list[Frame] = []
    samples: list[list[Sample]] = [[] for _ in range(columns)]
    for sequence in range(-(-SPAN // (rows * period))):
        stated = begin + (sequence * rows + np.arange(rows)) * period
        true = stated + wrong
        swing = np.sin(2 * np.pi * hertz * (true[:, np.newaxis] - START) / 1e9 + phase)
        values = 1000.0 + height * np.where(height > 1000.0, np.sign(swing), swing)
        values += random.uniform(-1, 1, values.shape)
        if sequence in lost:
            continue
        below, above = random.choice([1.0, 200.0], (2, *values.shape))
        packed = PatchSamples.pack(
            Interval(values - below, values + above), 1.0, patch=number, grid=0,
            first_row=sequence * rows,
        )  # fmt: skip
        first = int(stated[0])
        grid = Grid(0, period, sequence * rows, rows, 1.0)
        time = first - error, first + error
        frames.append(
            Frame(Position(1, sequence), world.layout.content_hash, number,
                  sequence * rows * period, time, (grid,), (packed,))
        )  # fmt: skip
        for column, row in ((c, r) for c in range(columns) for r in range(rows)):
            t = int(true[row])
            samples[column].append(Sample(t, t + period, float(values[row, column])))
    return frames, samples


def components(pressed: set[int], edges: list[tuple[int, int]]) -> Iterator[set[int]]:
    """Connected sets of taxels, by a search of our own."""
    left = set(pressed)
    while left:
        found, fresh = set(), {left.pop()}
        while fresh:
            found |= fresh
            fresh = {
                b
                for pair in edges
                for a, b in (pair, pair[::-1])
                if a in fresh and b in pressed and b not in found
            }
            left -= fresh
        yield found
