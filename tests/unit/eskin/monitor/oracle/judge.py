"""Compares the library's verdicts on random scenes with their definition."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from itertools import chain
from random import Random
from typing import TYPE_CHECKING

from eskin.interval import Verdict
from eskin.monitor import is_exact
from tests.unit.eskin.monitor.oracle.draw import draw_scene
from tests.unit.eskin.monitor.oracle.formulas import Channel, Operation, atoms, write
from tests.unit.eskin.monitor.oracle.library import SAID, ask, signal
from tests.unit.eskin.monitor.oracle.semantics import enclose_truth, holds
from tests.unit.eskin.monitor.oracle.worlds import draw_world, level_worlds

if TYPE_CHECKING:
    from tests.unit.eskin.monitor.oracle.draw import Scene

SEARCHED = 300
"""Worlds that are drawn until a possible verdict has one of each kind."""


@dataclass
class Outcome:
    """What came out for some scenes.

    Attributes:
        scenes: How many were drawn.
        exact: How many have exact enclosures and a formula that the parser calls exact.
        verdicts: How many of each verdict were compared.
        wrong: A line for each scene with a verdict that is wrong, or says too little.
    """

    scenes: int = 0
    exact: int = 0
    verdicts: Counter[Verdict] = field(default_factory=Counter)
    wrong: list[str] = field(default_factory=list)

    def add(self, other: Outcome) -> None:
        """Take in what came out for other scenes."""
        self.scenes += other.scenes
        self.exact += other.exact
        self.verdicts += other.verdicts
        self.wrong += other.wrong


def judge(seeds: range, *, label: str) -> Outcome:
    """Draw scenes and compare.

    Args:
        seeds: One for each scene.
        label: What else the scenes depend on.
    """
    outcome = Outcome()
    for seed in seeds:
        random = Random(f"{label} {seed}")
        scene = draw_scene(random)
        found = _compare(scene, random, outcome)
        outcome.scenes += 1
        if found:
            outcome.wrong.append(f"{label} {seed}: {found}: {write(scene.formula)}")
    return outcome


def _compare(scene: Scene, random: Random, outcome: Outcome) -> str:
    """What is wrong with the library's verdicts; empty if nothing is."""
    verdicts = ask(scene)
    units = {name: signal(samples).unit for name, samples in scene.known.items()}
    exact = bool(is_exact(verdicts.formula, units)) and all(
        samples.exact_instants for samples in scene.known.values()
    )
    outcome.exact += exact
    lower, upper = enclose_truth(scene.formula, scene.known)
    open_at = []
    for t, code in zip(scene.instants, verdicts.codes_at(scene.instants).tolist(), strict=True):
        said, expected = Verdict(code), SAID[lower(t), upper(t)]
        outcome.verdicts[said] += 1
        if said is Verdict.POSSIBLE:
            open_at.append(t)
        if said is expected or (said is Verdict.POSSIBLE and _is_rounded(scene) and not exact):
            continue
        return f"{said.name} at {t}, not {expected.name}"
    if exact:
        return _without_worlds(scene, open_at, random)
    return ""


def _is_rounded(scene: Scene) -> bool:
    """Whether floats hold the values of expressions only outward."""
    units = {samples.kilo for samples in scene.known.values()}
    return any(
        isinstance(side, Operation)
        or (len(units) > 1 and isinstance(atom.left, Channel) and isinstance(atom.right, Channel))
        for atom in atoms(scene.formula)
        for side in (atom.left, atom.right)
    )


def _without_worlds(scene: Scene, instants: list[int], random: Random) -> str:
    """An instant at which no world is found that makes the formula true, or none that does not."""
    true, false = set[int](), set[int]()
    worlds = chain.from_iterable(
        level_worlds(scene.formula, scene.known, best=best) for best in (True, False)
    )
    for _ in range(SEARCHED):
        world = next(worlds, None)
        if world is None:
            world = draw_world(random, scene.formula, scene.known, scene.instants)
        found = holds(scene.formula, world)
        for t in instants:
            (true if found(t) else false).add(t)
        if len(true) == len(false) == len(instants):
            return ""
    missing = sorted(set(instants) - (true & false))
    kind = "that makes it false" if missing[0] in true else "that makes it true"
    return f"called exact, and POSSIBLE at {missing[0]}, but no world was found {kind}"
