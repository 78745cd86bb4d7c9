"""What the text states, what its equations give, and the verdict, written down a second time."""

from __future__ import annotations

import csv
from typing import TYPE_CHECKING

import numpy as np
import pytest

from eskin.figures.paper import write_statements

if TYPE_CHECKING:
    from pathlib import Path

PLATE = 8.854e-12 * 1e-4
TURN = 2.0 * np.pi


def icm(constant: float, time: float) -> float:
    """What a first-order circuit makes of ``sin(ωt − 46°)`` from rest, by phasors."""
    phasor = np.exp(1j * np.radians(-46.0)) / (1.0 + 1j * TURN * 50.0 * constant)
    steady = (phasor * np.exp(1j * TURN * 50.0 * time)).imag
    return float(steady - phasor.imag * np.exp(-time / constant))


def coil(distance: float) -> float:
    return float(10e-3 - 5e-3 * np.exp(-10.0 * distance))


EXPECTED = [
    (0.295e-12, PLATE / 3e-3, "correct"),
    (0.21e-12, PLATE / 4e-3, "slip"),
    (0.22e-12, PLATE / 4e-3, "correct"),
    (0.18e-12, PLATE / 5e-3, "correct"),
    (0.5e-12, 0.6 * PLATE / 1e-3, "correct"),
    (0.5e-12, 0.8 * PLATE / 1e-3, "slip"),
    (0.7e-12, 0.8 * PLATE / 1e-3, "correct"),
    (100e-9, 100e-6, "factor 1000"),
    (100e-9, 100e-9, "correct"),
    (1e-6, 1e-3, "factor 1000"),
    (100e-9, 156.8e-9, "correct"),
    (10e-12, -80e-12, "wrong sign"),
    (0.125e-6, 0.125e-6, "correct"),
    (1050e-6, 1050e-6, "correct"),
    (20e-6, coil(10.75e-3) - coil(10e-3), "factor 1.7"),
    (20e-6, coil(30e-3) - coil(29.25e-3), "factor 1.4"),
    (1e7, 1.0 / (TURN * 1e3 * 100e-12), "factor 6.28"),
    (5.0, np.hypot(5.0, TURN * 1e3 * 10e-3), "factor 12.6"),
    (-1.0, 5.0 * icm(2419.0 * 1e-6, 1e-3), "correct"),
    (-0.36e-3, 5e-4 * icm(1e-7, 1e-6), "correct"),
    (-0.24e-3, 5e-4 * icm(1e-7, 1e-3), "correct"),
]


def test_each_statement_has_its_number_and_its_verdict(tmp_path: Path) -> None:
    with write_statements(tmp_path / "paper.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    for row, (stated, computed, verdict) in zip(rows, EXPECTED, strict=True):
        assert float(row["stated"]) == stated, row
        assert float(row["computed"]) == pytest.approx(computed, rel=1e-4, abs=0.0), row
        assert row["verdict"] == verdict, row
