"""Each bad scenario gives one line with file, place and reason."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from eskin_sensor_node.world.scenario import Stage, read_scenario, scenario_names

from eskin.errors import ScenarioError
from tests.unit.sensor_node.scenario.scripts import HEAD, TAP, script, write

if TYPE_CHECKING:
    from pathlib import Path

SLIDE = """
[[event]]
kind = "slide"
path = ["t00", "t11", "t12"]
at_s = 1.0
duration_s = 1.0
force_N = 1.0
radius_m = 4e-3
"""
NOISE = '\n[[event]]\nkind = "noise"\nat_s = 0.0\nduration_s = 1.05\n'
APPROACH = """
[[event]]
kind = "approach"
at = "t05"
at_s = 1.0
duration_s = 1.0
rise_s = 0.6
near_m = 0.01
"""

BAD = {
    "no such taxel": (
        HEAD + TAP.replace("t05", "t12"),
        "event 1 (tap).at: taxel 't12' is not there; the skin has t00 to t11",
    ),
    "no such taxel on a path": (HEAD + TAP + SLIDE, "event 2 (slide).path: taxel 't12' is not"),
    "broken taxel that is not there": (
        HEAD + '[[fault]]\ntaxel = "t99"\nkind = "dead"\n',
        "fault 1.taxel: taxel 't99' is not there",
    ),
    "worn taxel that is not there": (
        HEAD + '[[wear]]\ntaxel = "t99"\n',
        "wear 1.taxel: taxel 't99' is not there",
    ),
    "wet taxel that is not there": (
        HEAD + '[[film]]\ntaxel = "t99"\nat_s = 0.0\nduration_s = 1.0\nshare = 0.1\n',
        "film 1.taxel: taxel 't99' is not there",
    ),
    "late": (HEAD + TAP.replace("at_s = 1.0", "at_s = 9.9"), "event 1 (tap): it ends at 10.1 s"),
    "disturbed": (HEAD + NOISE + TAP, "event 1 (noise): event 2 (tap) happens in it"),
    "disturbed by a variation": (
        HEAD + NOISE.replace("1.05", "1.0") + TAP + "[variation]\ntime_s = 0.1\n",
        "event 1 (noise): event 2 (tap) happens in it",
    ),
    "unknown kind": (HEAD + TAP.replace('"tap"', '"kick"'), "event 1"),
    "unknown key": (HEAD + TAP + "force_kN = 1.0\n", "event 1 (tap).force_kN: no such key"),
    "missing": (HEAD + TAP.replace("force_N = 1.0\n", ""), "event 1 (tap).force_N: it is missing"),
    "negative": (
        HEAD + TAP.replace("force_N = 1.0", "force_N = -1.0"),
        "event 1 (tap).force_N: -1.0 is",
    ),
    "nan": (HEAD + TAP.replace("force_N = 1.0", "force_N = nan"), "event 1 (tap).force_N: nan is"),
    "text": (HEAD + TAP.replace("force_N = 1.0", 'force_N = "1"'), "event 1 (tap).force_N: '1' is"),
    "no period": (HEAD + TAP + "times = 2\n", "event 1 (tap): "),
    "short period": (HEAD + TAP + "times = 2\nevery_s = 0.1\n", "event 1 (tap).every_s: 0.1 is"),
    "long ramp": (HEAD + APPROACH, "event 1 (approach).rise_s: 0.6 is not allowed"),
    "ambient backwards": (
        HEAD + "[ambient]\ntemperature_Cel = [[1.0, 20.0], [1.0, 21.0]]\n",
        "ambient.temperature_Cel: ",
    ),
    "skin": (HEAD.replace("rows = 3", "rows = 0"), "skin (flat).rows: 0 is not allowed"),
    "huge": (
        HEAD.replace("rows = 3", "rows = 1000").replace("columns = 4", "columns = 1000"),
        "skin (flat).columns: 1000 is not allowed",
    ),
    "no shape": (HEAD.replace('"flat"', '"round"'), "skin: "),
    "mid-line": (HEAD + TAP[:-12], "file: it is no TOML that can be read: "),
    "no duration": (HEAD.replace("duration_s = 10.0", "duration_s = 0.0"), "duration_s: 0.0 is"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_scenario_gives_one_line_with_file_place_and_reason(name: str, tmp_path: Path) -> None:
    text, said = BAD[name]
    path = write(tmp_path, text)
    with pytest.raises(ScenarioError) as caught:
        read_scenario(path)
    assert str(caught.value).startswith(f"{path}: {said}")
    assert not any(word in str(caught.value) for word in ["\n", "Value error"])
    assert str(caught.value).startswith(f"{caught.value.file}: {caught.value.place}: ")


def test_file_that_is_not_there_says_so(tmp_path: Path) -> None:
    with pytest.raises(ScenarioError, match=r"none\.toml: file: .* hand\.toml"):
        read_scenario(str(tmp_path / "none.toml"))


def test_bytes_that_are_no_text_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "scene.toml"
    path.write_bytes(b"description = \xff")
    with pytest.raises(ScenarioError, match="file: it is no text in UTF-8"):
        read_scenario(str(path))


def test_noise_may_touch_what_comes_before_and_after(tmp_path: Path) -> None:
    quiet = NOISE.replace("1.05", "1.0")
    assert len(script(tmp_path, HEAD + quiet + TAP).event) == 2


def test_file_that_changed_is_read_anew(tmp_path: Path) -> None:
    assert script(tmp_path, HEAD + TAP).duration_s == 10.0
    assert script(tmp_path, (HEAD + TAP).replace("= 10.0", "= 20.0")).duration_s == 20.0


@pytest.mark.parametrize("name", scenario_names())
def test_packaged_scenarios_can_be_played(name: str) -> None:
    scene = read_scenario(name)
    kinds = {event.kind for event in scene.event}
    assert (
        kinds
        == {
            "hand.toml": {"noise", "tap", "press", "hold", "slide", "approach"},
            "paper-hand.toml": {"noise", "tap", "press", "hold", "slide"},
            "small-hand.toml": {"noise", "tap", "press", "hold", "slide"},
            "walk.toml": {"noise", "hold"},
            "wear.toml": {"hold"},
        }[name]
    )
    stimulus = Stage(scene).stimulus(np.arange(0.0, scene.duration_s, 0.1))
    assert np.any(stimulus.pressure > 0.0)


def test_peak_pressure_adds_what_may_happen_together(tmp_path: Path) -> None:
    one = script(tmp_path, HEAD + TAP)
    assert one.peak_pressure == pytest.approx(one.event[0].pressure)  # type: ignore[union-attr]
    later = TAP.replace("at_s = 1.0", "at_s = 1.3")
    assert script(tmp_path, HEAD + TAP + later).peak_pressure == one.peak_pressure
    moved = HEAD + TAP + later + "[variation]\ntime_s = 0.06\nforce = 0.5\n"
    assert script(tmp_path, moved).peak_pressure == pytest.approx(3.0 * one.peak_pressure)
