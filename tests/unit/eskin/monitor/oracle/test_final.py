"""No later sample changes a verdict that is final, and verdicts become final in time."""

from __future__ import annotations

from dataclasses import replace
from random import Random
from typing import TYPE_CHECKING

from eskin.interval import Verdict
from tests.unit.eskin.monitor.oracle.draw import draw_scene
from tests.unit.eskin.monitor.oracle.formulas import reach, write
from tests.unit.eskin.monitor.oracle.library import ask

if TYPE_CHECKING:
    from tests.unit.eskin.monitor.oracle.signals import Samples

SCENES = 500


def draw_begin(random: Random, samples: Samples) -> Samples:
    """What was known of a channel before some of its samples came."""
    count = random.randint(0, len(samples))
    if count == len(samples):
        return samples
    gap = samples.gap[:count]
    if count and random.random() < 0.5:
        gap = (*gap[:-1], False)  # a gap is seen when the next sample comes
    next_one = samples.earliest[count]
    return replace(
        samples,
        earliest=samples.earliest[:count],
        latest=samples.latest[:count],
        lo=samples.lo[:count],
        hi=samples.hi[:count],
        gap=gap,
        until=None if count and samples.gap[count - 1] else random.choice((None, next_one - 1)),
    )


def test_no_later_sample_changes_a_final_verdict() -> None:
    final = possible = 0
    for seed in range(SCENES):
        random = Random(f"final {seed}")
        scene = draw_scene(random)
        known = {name: draw_begin(random, samples) for name, samples in scene.known.items()}
        earlier, later = ask(replace(scene, known=known)), ask(scene)
        for t in scene.instants:
            if earlier.final(t):
                assert earlier.at(t) is later.at(t), (seed, t, write(scene.formula))
                final += 1
                possible += earlier.at(t) is Verdict.POSSIBLE
    assert possible > SCENES
    assert final > 2 * possible


def test_what_is_decided_is_final() -> None:
    decided = 0
    for seed in range(SCENES):
        scene = draw_scene(Random(f"decided {seed}"))
        verdicts = ask(scene)
        for t in scene.instants:
            if verdicts.at(t) is not Verdict.POSSIBLE:
                assert verdicts.final(t), (seed, t, write(scene.formula))
                decided += 1
    assert decided > SCENES


def test_verdicts_are_final_once_samples_came_for_all_that_they_look_at() -> None:
    final = 0
    for seed in range(SCENES):
        scene = draw_scene(Random(f"in time {seed}"))
        verdicts = ask(scene)
        ends = [samples.enclosures[-1][0] for samples in scene.known.values() if len(samples)]
        if len(ends) < len(scene.known):
            continue
        _, future = reach(scene.formula)
        for t in scene.instants:
            if t + future < min(ends):
                assert verdicts.final(t), (seed, t, write(scene.formula))
                final += 1
    assert final > SCENES
