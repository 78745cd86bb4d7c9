"""Robustness encloses that of each world, and its ends are reached where a formula is exact."""

from __future__ import annotations

from random import Random
from typing import TYPE_CHECKING

import pytest

from eskin.interval import Verdict
from tests.unit.eskin.monitor.oracle.draw import draw_scene
from tests.unit.eskin.monitor.oracle.formulas import write
from tests.unit.eskin.monitor.oracle.library import ask
from tests.unit.eskin.monitor.oracle.robustness import robustness
from tests.unit.eskin.monitor.oracle.worlds import FAR, draw_world, extreme

if TYPE_CHECKING:
    from tests.unit.eskin.monitor.oracle.draw import Scene

SCENES = 80
ROUNDED = 1e-9


def draw(seed: int) -> tuple[Scene, Random]:
    """A scene whose channels are in one unit, in which robustness is stated."""
    random = Random(f"robustness {seed}")
    while True:
        scene = draw_scene(random, samples=5)
        if not any(samples.kilo for samples in scene.known.values()):
            return scene, random


def test_robustness_encloses_that_of_each_world() -> None:
    for seed in range(SCENES):
        scene, random = draw(seed)
        verdicts = ask(scene)
        world = draw_world(random, scene.formula, scene.known, scene.instants)
        found = robustness(scene.formula, world)
        for t in random.sample(scene.instants, 3):
            said = verdicts.robustness(t)
            assert float(said.inf) <= found(t) <= float(said.sup), (seed, t, write(scene.formula))


def test_robustness_has_the_sign_of_the_verdict() -> None:
    for seed in range(SCENES):
        scene, random = draw(seed)
        verdicts = ask(scene)
        for t in random.sample(scene.instants, 3):
            said, verdict = verdicts.robustness(t), verdicts.at(t)
            allowed = {
                Verdict.CERTAIN: said.inf >= 0,
                Verdict.POSSIBLE: said.inf <= 0 <= said.sup,
                Verdict.IMPOSSIBLE: said.sup <= 0,
            }
            assert allowed[verdict], (seed, t, write(scene.formula))


def test_ends_of_robustness_are_those_of_the_extreme_worlds() -> None:
    compared = 0
    for seed in range(SCENES):
        scene, random = draw(seed)
        best, worst = (extreme(scene.formula, scene.known, best=b) for b in (True, False))
        if best is None or worst is None:
            continue
        verdicts = ask(scene)
        least, most = robustness(scene.formula, worst), robustness(scene.formula, best)
        for t in random.sample(scene.instants, 3):
            said = verdicts.robustness(t)
            for end, reached in ((said.inf, least(t)), (said.sup, most(t))):
                if -FAR // 10 < reached < FAR // 10:
                    assert end == pytest.approx(float(reached), abs=ROUNDED), (seed, t)
                    compared += 1
    assert compared > SCENES / 3
