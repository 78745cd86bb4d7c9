"""Reasons of open verdicts, witnesses of decided ones, and how many samples a verdict rests on."""

from __future__ import annotations

from dataclasses import replace
from math import inf
from random import Random
from typing import TYPE_CHECKING

from eskin.interval import Verdict
from eskin.monitor import Because, evaluate, parse
from tests.unit.eskin.monitor.oracle.draw import draw_scene
from tests.unit.eskin.monitor.oracle.formulas import Operation, Within, atoms, reach, write
from tests.unit.eskin.monitor.oracle.library import ask, signals
from tests.unit.eskin.monitor.oracle.semantics import enclose_truth
from tests.unit.eskin.monitor.oracle.worlds import FAR

if TYPE_CHECKING:
    from tests.unit.eskin.monitor.oracle.draw import Scene
    from tests.unit.eskin.monitor.oracle.signals import Samples

SCENES = 120
MISSED = 1 / 1024


def without(cause: Because, samples: Samples, middle: Samples) -> Samples:
    """Samples that leave nothing open for one cause."""
    if cause is Because.WIDTH:
        return replace(samples, hi=samples.lo)
    if cause is Because.INSTANT:
        return replace(samples, earliest=middle.earliest, latest=middle.earliest)
    return replace(samples, gap=(False,) * len(samples))


def test_open_verdicts_have_reasons_and_others_none() -> None:
    for seed in range(SCENES):
        scene = draw_scene(Random(f"reasons {seed}"))
        verdicts = ask(scene)
        for t in scene.instants[:: max(1, len(scene.instants) // 8)]:
            is_open = verdicts.at(t) is Verdict.POSSIBLE
            assert bool(verdicts.because(t)) == is_open, (seed, t, write(scene.formula))


def has_expressions(scene: Scene) -> bool:
    return any(
        isinstance(side, Operation)
        for atom in atoms(scene.formula)
        for side in (atom.left, atom.right)
    )


def test_a_reason_that_is_taken_away_is_not_named() -> None:
    open_ones = 0
    for seed in range(SCENES):
        random = Random(f"taken {seed}")
        scene = draw_scene(random)
        if has_expressions(scene) or any(samples.kilo for samples in scene.known.values()):
            continue  # rounding is a width, too
        cause = random.choice((Because.WIDTH, Because.INSTANT, Because.GAP))
        known = {}
        for name, samples in scene.known.items():
            ascending = tuple(k * scene.step for k in range(len(samples)))
            known[name] = without(cause, samples, replace(samples, earliest=ascending))
        changed = replace(scene, known=known)
        verdicts = ask(changed)
        past, future = reach(scene.formula)
        begin = max((s.enclosures[0][1] if len(s) else inf for s in known.values()), default=0)
        end = min((s.enclosures[-1][0] if len(s) else -inf for s in known.values()), default=0)
        for t in changed.instants[:: max(1, len(changed.instants) // 8)]:
            named = verdicts.because(t)
            open_ones += bool(named)
            if cause is not Because.GAP or begin < t - past:
                assert cause not in named, (seed, t, cause, write(scene.formula))
            if t + future < end:
                assert Because.PENDING not in named, (seed, t, write(scene.formula))
    assert open_ones > SCENES / 2


def test_the_witness_of_a_decided_window_is_decided() -> None:
    compared = 0
    for seed in range(SCENES):
        random = Random(f"witness {seed}")
        scene = draw_scene(random)
        while not isinstance(scene.formula, Within):
            scene = draw_scene(random)
        formula, verdicts = scene.formula, ask(scene)
        lower, upper = enclose_truth(formula.operand, scene.known)
        some = formula.name in {"eventually", "once"}
        back = formula.name in {"historically", "once"}
        for t in scene.instants:
            witness = verdicts.witness(t)
            if verdicts.at(t) is not (Verdict.CERTAIN if some else Verdict.IMPOSSIBLE):
                assert witness is None
                continue
            assert witness is not None
            delay = t - witness if back else witness - t
            assert formula.window.begin - back <= delay <= formula.window.end + back or (
                formula.window.begin - 1 <= delay <= formula.window.end
            )
            here, after = (
                (lower(witness), lower.after(witness))
                if some
                else (not upper(witness), not upper.after(witness))
            )
            assert here or after, (seed, t, witness, write(formula))
            compared += 1
    assert compared > SCENES


def test_coverage_counts_each_sample_that_a_verdict_rests_on() -> None:
    """A sample counts if the verdict changes with it, and does not if it lies out of reach."""
    counted = 0
    for seed in range(SCENES // 6):
        random = Random(f"coverage {seed}")
        scene = draw_scene(random)
        read = signals(scene.known)
        for each in read.values():
            object.__setattr__(each, "coverage", 1 - MISSED)
        formula = parse(write(scene.formula))
        verdicts = evaluate(formula, read)
        past, future = reach(scene.formula)
        for t in random.sample(scene.instants, 2):
            rests = near = 0
            for name, samples in scene.known.items():
                for k, (first, _) in enumerate(samples.enclosures):
                    ends = samples.enclosures[k + 1][1] if k + 1 < len(samples) else inf
                    near += first <= t + future and ends >= t - past
                    for lo, hi in ((-FAR, -FAR), (FAR, FAR), (-FAR, FAR)):
                        other = replace(
                            samples,
                            lo=(*samples.lo[:k], lo, *samples.lo[k + 1 :]),
                            hi=(*samples.hi[:k], hi, *samples.hi[k + 1 :]),
                        )
                        now = ask(replace(scene, known=scene.known | {name: other})).at(t)
                        if now is not verdicts.at(t):
                            rests += 1
                            break
            said = round((1 - verdicts.coverage(t)) / MISSED)
            assert rests <= said <= near, (seed, t, write(scene.formula))
            counted += said
    assert counted > SCENES / 12
