"""What happens on a stage: where, when, how strong, and the same for the same seed."""

from __future__ import annotations

from dataclasses import fields
from typing import TYPE_CHECKING

import numpy as np
import pytest
from eskin_sensor_node.world.scenario import LABELS, Stage, read_scenario
from eskin_sensor_node.world.scenario.cast import Cast
from eskin_sensor_node.world.scenario.stimulus import overlap
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import trapezoid

from tests.unit.sensor_node.scenario.scripts import HEAD, TAP, script

if TYPE_CHECKING:
    from pathlib import Path

    from eskin_sensor_node.world.scenario import Stimulus

TIMES = np.arange(1000) / 100.0
SPOT = TAP.replace("radius_m = 4e-3", "radius_m = 2e-3")
APPROACH = """
[[event]]
kind = "approach"
at = "t05"
at_s = 1.0
duration_s = 2.0
near_m = 0.02
"""


def equal(one: Stimulus, other: Stimulus) -> bool:
    return all(
        np.array_equal(getattr(one, field.name), getattr(other, field.name))
        for field in fields(one)
    )


def integral(d: float, r: float, plate: float) -> float:
    """The lens by brute force: chords that both discs share, at each x."""
    x = np.linspace(-r, r, 20_001)
    chord = np.sqrt(np.maximum(r**2 - x**2, 0.0))
    other = np.sqrt(np.maximum(plate**2 - (x - d) ** 2, 0.0))
    return float(trapezoid(2.0 * np.minimum(chord, other), x))


@settings(max_examples=60, deadline=None, database=None)
@given(st.floats(0.0, 3.0), st.floats(0.05, 2.0))
def test_overlap_is_the_area_that_two_discs_share(distance: float, radius: float) -> None:
    found = overlap(np.array([distance]), np.array([radius]), 1.0)[0]
    assert found == pytest.approx(integral(distance, radius, 1.0), abs=2e-4)


def test_overlap_of_nothing_is_nothing() -> None:
    assert overlap(np.array([0.0, 1.0]), np.array([0.0, 0.0]), 1.0).tolist() == [0.0, 0.0]


def test_tap_reaches_its_force_in_its_middle_and_is_over_in_time(tmp_path: Path) -> None:
    stimulus = Stage(script(tmp_path, HEAD + SPOT)).stimulus(TIMES)
    load = stimulus.pressure[5] * 1e-4  # N on a cell of 1 cm²
    assert load.max() == pytest.approx(1.0)
    assert TIMES[load.argmax()] == pytest.approx(1.1)
    assert not load[TIMES <= 1.0].any()
    assert not load[TIMES > 1.2001].any()
    # The patch lies inside of the plate, so the other taxels feel nothing.
    assert np.flatnonzero(stimulus.pressure.max(axis=1)).tolist() == [5]
    assert stimulus.covered[5].max() == pytest.approx(np.pi * 2e-3**2 / 1e-4)


def test_force_follows_its_course_as_hertz_has_it(tmp_path: Path) -> None:
    stimulus = Stage(script(tmp_path, HEAD + SPOT)).stimulus(TIMES)
    inside = (TIMES > 1.0) & (TIMES < 1.2)
    share = np.sin(np.pi * (TIMES[inside] - 1.0) / 0.2)
    assert stimulus.pressure[5][inside] * 1e-4 == pytest.approx(share)
    assert stimulus.covered[5][inside] == pytest.approx(
        stimulus.covered[5].max() * share ** (2 / 3)
    )


def test_slide_moves_over_the_taxels_in_their_order(tmp_path: Path) -> None:
    slide = (
        '[[event]]\nkind = "slide"\npath = ["t00", "t03", "t11"]\nat_s = 2.0\nduration_s = 5.0\n'
    )
    slide += "force_N = 1.0\nradius_m = 4e-3\n"
    stimulus = Stage(script(tmp_path, HEAD + slide)).stimulus(TIMES)
    way = [0, 1, 2, 3, 7, 11]
    weights = stimulus.covered[way]
    middles = (weights * TIMES).sum(axis=1) / weights.sum(axis=1)
    assert np.all(np.diff(middles) > 0.5)
    assert middles[[1, 2, 3]] == pytest.approx([3.0, 4.0, 5.0], abs=0.1)  # a constant pace
    assert {LABELS[k] for k in np.unique(stimulus.labels[way])} == {"noise", "slide"}


def test_hold_stays_and_press_does_not(tmp_path: Path) -> None:
    for kind, held in (("hold", 0.6), ("press", 0.1)):
        text = HEAD + SPOT.replace("tap", kind).replace("duration_s = 0.2", "duration_s = 1.0")
        pressure = Stage(script(tmp_path, text)).stimulus(TIMES).pressure[5]
        share = np.mean(pressure[(TIMES >= 1.0) & (TIMES < 2.0)] > 0.99 * pressure.max())
        assert (share > held) == (kind == "hold")


def test_labels_say_what_touches_each_taxel(tmp_path: Path) -> None:
    stimulus = Stage(script(tmp_path, HEAD + TAP + APPROACH)).stimulus(TIMES)
    tap, approach = LABELS.index("tap"), LABELS.index("approach")
    touched = stimulus.covered > 0.0
    assert np.array_equal(stimulus.labels == tap, touched)
    near = (stimulus.metal_distance < 0.1) & ~touched
    assert np.array_equal(stimulus.labels == approach, near)
    assert near.any()


def test_metal_comes_along_the_normal_and_is_further_from_others(tmp_path: Path) -> None:
    distance = Stage(script(tmp_path, HEAD + APPROACH)).stimulus(TIMES).metal_distance
    assert distance[5].min() == pytest.approx(0.02)
    assert distance[6].min() == pytest.approx(np.hypot(0.02, 0.01))
    assert np.all(distance[:, (TIMES <= 1.0) | (TIMES >= 3.0)] == 1.0)
    # It comes, it does not appear.
    assert np.abs(np.diff(distance[5])).max() < 0.05


def test_metal_sets_the_quality_of_its_eddy_currents(tmp_path: Path) -> None:
    text = HEAD + APPROACH + "quality = 3.0\n"
    stimulus = Stage(script(tmp_path, text)).stimulus(TIMES)
    assert np.all(stimulus.metal_quality[:, 200] == 3.0)
    assert np.all(stimulus.metal_quality[:, 0] == 10.0)


def test_surroundings_lie_on_lines_between_their_points(tmp_path: Path) -> None:
    text = HEAD + "[ambient]\ntemperature_Cel = [[2.0, 20.0], [4.0, 30.0]]\n"
    text += "humidity_percent = [[0.0, 40.0]]\n[bioelectric]\namplitude_V = 1e-3\nrate_Hz = 2.0\n"
    stimulus = Stage(script(tmp_path, text)).stimulus(TIMES)
    assert stimulus.temperature[[0, 200, 300, 400, 999]].tolist() == [20.0, 20.0, 25.0, 30.0, 30.0]
    assert np.all(stimulus.humidity == 40.0)
    beats = np.flatnonzero(stimulus.bioelectric > 0.99e-3)
    assert TIMES[beats] == pytest.approx(0.25 + 0.5 * np.arange(20))


@pytest.mark.parametrize("name", ["t00", "t05", "t15"])
def test_one_taxel_alone_equals_itself_among_all(name: str) -> None:
    hand = read_scenario("hand.toml")
    every, alone = Stage(hand).stimulus(TIMES), Stage(hand, [name]).stimulus(TIMES)
    row = int(name[1:])
    assert np.array_equal(every.felt[row], alone.felt[0])
    assert np.array_equal(every.labels[row], alone.labels[0])


def test_time_in_pieces_gives_the_same_as_in_one() -> None:
    hand = read_scenario("hand.toml")
    times = np.arange(0.0, 60.0, 0.03)
    whole = Stage(hand).stimulus(times)
    stage = Stage(hand)
    parts = [stage.stimulus(piece).felt for piece in np.array_split(times, 17)]
    assert np.array_equal(whole.felt, np.concatenate(parts, axis=1))


def test_same_seed_gives_the_same_and_another_seed_something_else() -> None:
    hand = read_scenario("hand.toml")
    one, again, other = (Stage(hand, seed=seed).stimulus(TIMES) for seed in (3, 3, 4))
    assert equal(one, again)
    assert not np.array_equal(one.felt, other.felt)


def test_repetition_varies_and_without_it_nothing_more_happens() -> None:
    hand = read_scenario("hand.toml")
    first, second = (Stage(hand).stimulus(TIMES + start).pressure for start in (0.0, 20.0))
    assert second.any()
    assert not np.array_equal(first, second)
    once = hand.model_copy(update={"repeat": False})
    assert not Stage(once).stimulus(TIMES + 20.0).pressure.any()


def test_varied_places_stay_on_the_skin(tmp_path: Path) -> None:
    text = HEAD.replace('"flat"', '"cylinder"').replace("0.01", "0.05") + TAP
    design = script(tmp_path, text + "[variation]\nposition_m = 5e-3\n")
    stage = Stage(design)
    normal, centre = stage.skin.normals[5], stage.skin.positions[5]
    assert abs(normal[0]) > 0.9  # not along z
    for seed in range(20):
        cast = Cast.draw(design, stage.skin, np.random.default_rng(seed))
        moved = cast.contacts[0].way[0] - centre
        assert moved @ normal == pytest.approx(0.0, abs=1e-12)
        assert np.linalg.norm(moved) > 0.0


def test_variations_stay_within_their_bounds(tmp_path: Path) -> None:
    text = HEAD + SPOT + "[variation]\ntime_s = 0.3\nforce = 0.2\nposition_m = 1e-3\n"
    design = script(tmp_path, text)
    times = np.arange(0.0, 2.0, 1e-3)
    begins, forces = [], []
    for seed in range(100):
        load = Stage(design, seed=seed).stimulus(times).pressure[5] * 1e-4
        begins.append(times[load.argmax()] - 0.1)
        forces.append(load.max())
    assert 0.7 <= min(begins) < 0.8
    assert 1.2 < max(begins) <= 1.3
    assert 0.8 <= min(forces) < 0.85
    assert 1.15 < max(forces) <= 1.2
