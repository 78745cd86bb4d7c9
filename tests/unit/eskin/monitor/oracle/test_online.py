"""What a monitor decides sample by sample is what the whole record says."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from math import inf
from random import Random
from typing import TYPE_CHECKING

from eskin.monitor import Monitor, parse
from tests.unit.eskin.monitor.oracle.draw import UNIT, draw_scene
from tests.unit.eskin.monitor.oracle.formulas import reach, write
from tests.unit.eskin.monitor.oracle.library import ask

if TYPE_CHECKING:
    from eskin.monitor import Piece
    from tests.unit.eskin.monitor.oracle.draw import Scene

SCENES = 150


def draw(seed: int) -> tuple[Scene, Random]:
    """A scene with bounded windows, of whose next samples nothing is known."""
    random = Random(f"online {seed}")
    while True:
        scene = draw_scene(random)
        if inf not in reach(scene.formula):
            known = {name: replace(each, until=None) for name, each in scene.known.items()}
            return replace(scene, known=known), random


def contains(piece: Piece, t: int) -> bool:
    after = piece.start is None or piece.start < t or (piece.start == t and piece.includes_start)
    before = piece.end is None or t < piece.end or (piece.end == t and piece.includes_end)
    return after and before


def test_pieces_that_are_taken_are_those_of_the_whole_record() -> None:
    compared = 0
    for seed in range(SCENES):
        scene, random = draw(seed)
        units = {name: ("k" if each.kilo else "") + UNIT for name, each in scene.known.items()}
        monitor = Monitor(parse(write(scene.formula)), units)
        coming = {name: list(range(len(each))) for name, each in scene.known.items()}
        pieces: list[Piece] = []
        while any(coming.values()):
            name = random.choice([name for name, left in coming.items() if left])
            samples, k = scene.known[name], coming[name].pop(0)
            factor = 1000 if samples.kilo else 1
            monitor.push(
                name,
                samples.earliest[k],
                samples.latest[k],
                float(samples.lo[k] / factor),
                float(samples.hi[k] / factor),
                period=samples.period,
            )
            if samples.gap[k]:
                monitor.gap(name)
            if random.random() < 0.5:
                pieces += monitor.take()
        pieces += monitor.take()
        for one, other in pairwise(pieces):
            assert one.end == other.start
            assert one.includes_end != other.includes_start
        record = ask(scene)
        for t in scene.instants:
            for piece in pieces:
                if contains(piece, t):
                    assert piece.verdict is record.at(t), (seed, t, write(scene.formula))
                    compared += 1
    assert compared > 5 * SCENES
