"""The definition of verdicts is sound over all worlds, and exact where it says so."""

from __future__ import annotations

from random import Random
from typing import TYPE_CHECKING

import pytest

from tests.unit.eskin.monitor.oracle.draw import draw_samples, draw_scene
from tests.unit.eskin.monitor.oracle.formulas import (
    Channel,
    Number,
    atoms,
    write,
)
from tests.unit.eskin.monitor.oracle.semantics import enclose_truth, holds
from tests.unit.eskin.monitor.oracle.traces import Trace, combine
from tests.unit.eskin.monitor.oracle.worlds import draw_world, every_world, extreme

if TYPE_CHECKING:
    from tests.unit.eskin.monitor.oracle.draw import Scene
    from tests.unit.eskin.monitor.oracle.semantics import Pair

SCENES = 600
MOST_WORLDS = 400


def always_true(trace: Trace[bool]) -> bool:
    return all(trace.at) and all(trace.between)


def lies_between(pair: Pair, found: Trace[bool]) -> bool:
    lower, upper = pair
    return always_true(combine(lambda a, b, c: a <= b <= c, [lower, found, upper]))


def test_no_drawn_world_violates_a_verdict() -> None:
    for seed in range(SCENES):
        random = Random(f"drawn {seed}")
        scene = draw_scene(random)
        pair = enclose_truth(scene.formula, scene.known)
        for _ in range(2):
            world = draw_world(random, scene.formula, scene.known, scene.instants)
            assert lies_between(pair, holds(scene.formula, world)), (seed, write(scene.formula))


def few_worlds(random: Random) -> Scene:
    """A scene with so few worlds that all can be looked at."""
    while True:
        scene = draw_scene(random, depth=2, samples=8)
        count = 1
        for samples in scene.known.values():
            spread = sum(a < b for a, b in samples.enclosures)
            wide = sum(a < b for a, b in zip(samples.lo, samples.hi, strict=True))
            count *= 2 ** (spread + 1) * 4**wide
        if len(scene.known) and 2 < count <= MOST_WORLDS:
            return scene


def test_no_world_at_all_violates_a_verdict() -> None:
    worlds = most = 0
    for seed in range(SCENES // 6):
        scene = few_worlds(Random(f"all {seed}"))
        pair = enclose_truth(scene.formula, scene.known)
        most = max(most, *(len(samples) for samples in scene.known.values()))
        for world in every_world(scene.formula, scene.known, []):
            assert lies_between(pair, holds(scene.formula, world)), (seed, write(scene.formula))
            worlds += 1
    assert most == 8
    assert worlds > 10 * SCENES / 6


def test_formulas_of_one_direction_are_decided_by_two_worlds() -> None:
    exact = 0
    for seed in range(SCENES):
        scene = draw_scene(Random(f"extreme {seed}"))
        best, worst = (extreme(scene.formula, scene.known, best=b) for b in (True, False))
        if best is None or worst is None:
            continue
        lower, upper = enclose_truth(scene.formula, scene.known)
        assert holds(scene.formula, best) == upper, (seed, write(scene.formula))
        assert holds(scene.formula, worst) == lower, (seed, write(scene.formula))
        exact += 1
    assert exact > SCENES / 4


@pytest.mark.nightly
def test_comparisons_are_exact_at_each_instant_also_where_instants_are_uncertain() -> None:
    """Each comparison of one channel that is possible at an instant has both kinds of worlds."""
    possible = 0
    for seed in range(SCENES // 40):
        random = Random(f"atom {seed}")
        atom = next(atoms(draw_scene(random).formula))
        sides = {type(atom.left), type(atom.right)}
        if sides != {Channel, Number}:
            continue
        name = (atom.left if isinstance(atom.left, Channel) else atom.right).name  # type: ignore[union-attr]
        known = {name: draw_samples(random, 3, 4, exact=False)}
        lower, upper = enclose_truth(atom, known)
        for t in sorted({u + d for pair in known[name].enclosures for u in pair for d in (0, 2)}):
            near = range(t - 2, t + 3)  # as many on each side as samples may be
            found = {holds(atom, world)(t) for world in every_world(atom, known, near)}
            assert (lower(t), upper(t)) == (min(found), max(found)), (seed, t)
            possible += len(found) == 2
    assert possible > SCENES / 40
