"""The page of the figures says what the equations give, and shows what the code draws."""

from __future__ import annotations

import re
from pathlib import Path
from statistics import NormalDist

import numpy as np
import pytest
from matplotlib.image import imread

from eskin.figures.gallery import FIGURES

DOCS = Path(__file__).parents[4] / "docs"
PAGE = " ".join((DOCS / "figures.md").read_text().split())
PI, EPSILON_0 = np.pi, 8.854e-12
TIME = np.linspace(0.0, 0.5, 500_001)
SWING = 10e-12 + 90e-12 * np.sin(4.0 * PI * TIME)
EARLY = TIME <= 0.125
LEFT_OUT = 5.0 * np.sin(100.0 * PI * TIME) * 90e-12 * 4.0 * PI * np.cos(4.0 * PI * TIME)


def inductance(distance: float) -> float:
    return float(10e-3 - 5e-3 * np.exp(-10.0 * distance))


def frequency(time: float) -> float:
    distance = 0.02 + 0.01 * np.sin(2.0 * PI * time)
    return float(1.0 / (2.0 * PI * np.sqrt(inductance(distance) * 1e-6)))


def ahead(time: float) -> float:
    """How much too fast the paper's sine runs: t·(df/dt)/f."""
    slope = (frequency(time + 1e-6) - frequency(time - 1e-6)) / 2e-6
    return time * slope / frequency(time)


def plate(distance: float) -> float:
    return EPSILON_0 * 1e-4 / distance * 1e12


def best(sigma: float, residue: float) -> float:
    """Least share of errors of the worse kind, over all thresholds."""
    below = NormalDist(0.0, sigma).cdf
    limits = np.linspace(0.0, 12e-6, 2401)
    return min(max(below(residue - t), below(t - 10e-6 + residue)) for t in limits)


AMPERE = 2.0 * PI * 50.0 * 5.0
EULER = np.log1p(-1e-5 * 8.0 / 11e-3) + 1e-5 * 8.0 / 11e-3
FAR_UH = (inductance(30e-3) - inductance(29.25e-3)) * 1e6
NEAR_UH = (inductance(10.75e-3) - inductance(10e-3)) * 1e6
CLAIMS = [
    f"from {plate(5e-3):.3f} to {plate(1e-3) * 10.0:.3f} pF over all parameters",
    f"by {-100.0 * np.expm1(500 * EULER):.1f} % after 5 ms",
    f"passes 100 nA at {100e-9 / AMPERE * 1e12:.1f} pF",
    f"V·dC/dt: up to {np.max(np.abs(LEFT_OUT[EARLY])) * 1e9:.1f} nA",
    f"half a second later, where the paper's sine runs {100.0 * ahead(0.505):.0f} % too fast",
    f"{plate(3e-3):.4f}, {plate(4e-3):.4f}, {plate(5e-3):.4f} pF",
    f"correct: {plate(1e-3) * 0.6:.3f} to {plate(1e-3) * 0.8:.3f} pF",
    f"correct: {AMPERE * 10e-3:.1f} to {AMPERE * 0.1:.0f} nA",
    f"the capacitance to −{-np.min(SWING) * 1e12:.0f} pF",
    f"negative from {TIME[np.argmax(SWING < 0.0)]:.3f} s",
    f"ωL alone is {2.0 * PI * 9.0:.0f} to {2.0 * PI * 11.0:.0f} Ω at 1 kHz",
    f"{FAR_UH:.0f} to {NEAR_UH:.0f} µH over 10 to 30 mm",
    f"{0.5 * 0.5**2:.3f} µW a taxel, {8400 * 0.5 * 0.5**2:.0f} µW a hand",
]


@pytest.mark.parametrize("claim", CLAIMS)
def test_number_of_the_page_is_what_the_equations_give(claim: str) -> None:
    assert claim in PAGE


def test_errors_at_the_best_threshold_are_as_few_as_the_page_says() -> None:
    assert "fewer than one error in 30,000 of either kind" in PAGE
    assert best(1e-6, 1e-6) < 1.0 / 30_000
    assert "with σ = 0.04 cm² one in ten is wrong at best" in PAGE
    assert best(4e-6, 0.0) == pytest.approx(0.1, abs=0.02)


def test_current_settles_within_a_microsecond() -> None:
    assert "within a microsecond" in PAGE
    assert np.exp(-1e-6 / (1e-3 / 1e4)) < 1e-4


def test_committed_pictures_are_what_the_code_draws(folder: Path) -> None:
    committed = {path.name for path in (DOCS / "images" / "figures").iterdir()}
    assert committed == {f"{name}.png" for name in FIGURES} | {"design.png"}
    for name in sorted(committed):
        old, new = imread(DOCS / "images" / "figures" / name), imread(folder / name)
        assert old.shape == new.shape, name
        # Another processor may differ in a last digit, and a pixel with it; a label is 1e-4.
        assert np.mean(np.abs(old - new)) < 5e-5, f"{name} is stale; run eskin figures"


def test_every_picture_of_the_docs_is_shown_on_a_page() -> None:
    pages = [*DOCS.rglob("*.md"), DOCS.parent / "README.md"]
    shown = {
        (page.parent / target).resolve()
        for page in pages
        for target in re.findall(r"!\[[^\]]*\]\(([^)]+\.png)\)", page.read_text())
    }
    assert shown == {path.resolve() for path in (DOCS / "images").rglob("*.png")}
