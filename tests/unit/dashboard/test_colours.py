"""Colours that everybody can tell apart, and see: measured on the style sheets' tokens."""

from __future__ import annotations

from itertools import combinations
from pathlib import Path

import eskin_cloud
import numpy as np
import pytest

from tests.unit.dashboard.browsing import SOURCE
from tests.unit.dashboard.vision import EYES, Colour, contrast, distance, lab, read_tokens, seen

LIGHT, DARK = read_tokens(SOURCE / "style" / "tokens.css")
THEMES = [pytest.param(LIGHT, id="light"), pytest.param(LIGHT | DARK, id="dark")]
MARKS = ("band-edge", "certain", "possible", "predicted-edge", "missing")
"""What gives each of a chart's marks its outline, or its lines."""
APART = 12.0
"""Two colours are just noticeably different, side by side, from 1 to 2 on (CIEDE2000)."""
SHAPES = 3.0
"""WCAG 2.2, 1.4.11: parts of graphics, and what shows where a control is."""
TEXT = 4.5
"""WCAG 2.2, 1.4.3."""
WRITTEN = [
    *((ink, ground) for ink in ("text", "text-soft") for ground in ("page", "plane", "raised")),
    *((ink, ground) for ink in ("accent", "good", "warn", "bad") for ground in ("page", "plane")),
    ("accent", "accent-soft"),
    ("bad", "bad-soft"),
    ("chart-text", "chart-plot"),
    ("chart-axis", "chart-plot"),
]
DRAWN = [(ink, ground) for ink in ("control", "accent") for ground in ("page", "plane", "raised")]
LOGIN = read_tokens(Path(eskin_cloud.__file__).parent / "api" / "login_page" / "login.css")


@pytest.mark.parametrize(
    ("one", "other", "expected"),
    [
        ((50.0, 2.6772, -79.7751), (50.0, 0.0, -82.7485), 2.0425),
        ((50.0, -1.3802, -84.2814), (50.0, 0.0, -82.7485), 1.0000),
        ((50.0, 0.0, 0.0), (50.0, -1.0, 2.0), 2.3669),
        ((50.0, 2.5, 0.0), (50.0, 0.0, -2.5), 4.3065),
        ((50.0, 2.5, 0.0), (73.0, 25.0, -18.0), 27.1492),
        ((60.2574, -34.0099, 36.2677), (60.4626, -34.1751, 39.4387), 1.2644),
        ((22.7233, 20.0904, -46.6940), (23.0331, 14.9730, -42.5619), 2.0373),
        ((2.0776, 0.0795, -1.1350), (0.9033, -0.0636, -0.5514), 0.9082),
    ],
)
def test_distance_is_that_of_the_published_pairs(
    one: tuple[float, ...], other: tuple[float, ...], expected: float
) -> None:
    """Sharma, Wu and Dalal 2005, table 1."""
    assert distance(np.array(one), np.array(other)) == pytest.approx(expected, abs=5e-5)


@pytest.mark.parametrize("eye", EYES)
def test_every_eye_sees_white_black_and_grey_as_they_are(eye: str) -> None:
    for level in (0, 128, 255):
        grey = Colour((level, level, level), 1.0)
        assert seen(grey, eye) == pytest.approx(grey.linear, abs=1e-3)


@pytest.mark.parametrize("eye", EYES)
@pytest.mark.parametrize("tokens", THEMES)
def test_marks_of_a_chart_are_distinguished(tokens: dict[str, str], eye: str) -> None:
    plot = Colour.read(tokens["chart-plot"])
    looks = {
        name: lab(seen(Colour.read(tokens[f"chart-{name}"]).on(plot), eye))
        for name in ("plot", *MARKS)
    }
    found = {
        f"{one} and {other}": round(distance(looks[one], looks[other]), 1)
        for one, other in combinations(looks, 2)
    }
    assert {pair: apart for pair, apart in found.items() if apart < APART} == {}


@pytest.mark.parametrize("tokens", THEMES)
def test_marks_of_a_chart_stand_out_from_it(tokens: dict[str, str]) -> None:
    pairs = [(f"chart-{mark}", "chart-plot") for mark in (*MARKS, "axis", "threshold")]
    assert faint(tokens, pairs, SHAPES) == {}


@pytest.mark.parametrize("tokens", THEMES)
def test_texts_and_controls_stand_out_from_what_they_lie_on(tokens: dict[str, str]) -> None:
    assert faint(tokens, WRITTEN, TEXT) == {}
    assert faint(tokens, DRAWN, SHAPES) == {}


@pytest.mark.parametrize("tokens", LOGIN, ids=["light", "dark"])
def test_login_can_be_read(tokens: dict[str, str]) -> None:
    written = [("ink", "card"), ("ink", "ground"), ("quiet", "card"), ("alarm", "card")]
    assert faint(tokens, [*written, ("on-accent", "accent")], TEXT) == {}
    assert faint(tokens, [("line", "card"), ("accent", "card")], SHAPES) == {}


def faint(tokens: dict[str, str], pairs: list[tuple[str, str]], least: float) -> dict[str, float]:
    """Which of these pairs of an ink and a ground have less contrast."""
    found = {}
    for ink, ground in pairs:
        below = Colour.read(tokens[ground])
        found[f"{ink} on {ground}"] = round(contrast(Colour.read(tokens[ink]).on(below), below), 2)
    return {pair: ratio for pair, ratio in found.items() if ratio < least}
