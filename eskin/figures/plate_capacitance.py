"""Fig. 4b, 7a and 7b: a plate capacitor with uncertain parameters."""

from __future__ import annotations

import numpy as np

from eskin.constants import PAPER_VACUUM_PERMITTIVITY
from eskin.figures.figure import Figure, Panel, band, middle
from eskin.interval import Interval
from eskin.models import capacitance, moving_plate

VACUUM = {"vacuum_permittivity": PAPER_VACUUM_PERMITTIVITY}
AREA_M2 = 1e-4
NEAREST_M = 1e-3
FARTHEST_M = 5e-3
DEVIATION = 0.05
"""Relative deviation of the distance in Fig. 7b; the paper gives none."""


def draw_fig4b() -> Figure:
    """Fig. 4b (eq. 2): εr 1 to 5, A 1 to 2 cm², over d 1 to 5 mm."""
    distance = np.linspace(NEAREST_M, FARTHEST_M, 401)
    uncertain = capacitance(
        relative_permittivity=Interval(1.0, 5.0),
        area=Interval(1e-4, 2e-4),
        distance=distance,
        **VACUUM,
    )
    nominal = capacitance(relative_permittivity=3.0, area=1.5e-4, distance=distance, **VACUUM)
    columns = {
        "distance_m": distance,
        "capacitance_F": middle(nominal),
        **band("capacitance", "F", uncertain),
    }
    return Figure(
        "fig4b",
        "Capacitive sensor with intervals",
        "Eq. 2 as the paper has it: εr from 1 to 5, A from 1 to 2 cm², drawn over the distance of "
        "1 to 5 mm; exact bounds. Line: εr = 3, A = 1.5 cm².",
        columns,
        "plate distance",
        (
            Panel(
                "capacitance",
                "F",
                lines={"εr = 3, A = 1.5 cm²": "capacitance_F"},
                bands={"all parameters": ("capacitance_lo_F", "capacitance_hi_F")},
            ),
        ),
    )


def draw_fig7a() -> Figure:
    """Fig. 7a (eq. 9): the distance swings at 0.5 Hz, and the capacitance with it."""
    time = np.linspace(0.0, 4.0, 4001)
    plate = moving_plate(
        time, area=AREA_M2, minimum_distance=NEAREST_M, maximum_distance=FARTHEST_M, **VACUUM
    )
    columns = {
        "time_s": time,
        "distance_m": middle(plate.distance),
        "capacitance_F": middle(plate.capacitance),
    }
    return Figure(
        "fig7a",
        "Plate distance and capacitance over time",
        "Eq. 9 as the paper has it: A = 1 cm², d from 1 to 5 mm at 0.5 Hz; 4 s at 1 kHz.",
        columns,
        "time",
        (
            Panel("distance", "m", lines={"d(t)": "distance_m"}),
            Panel("capacitance", "F", lines={"C(t)": "capacitance_F"}),
        ),
    )


def draw_fig7b() -> Figure:
    """Fig. 7b: capacitance over distance, with possible deviations of the distance."""
    distance = np.linspace(NEAREST_M, FARTHEST_M, 401)
    uncertain = capacitance(
        relative_permittivity=1.0,
        area=AREA_M2,
        distance=Interval.relative(distance, DEVIATION),
        **VACUUM,
    )
    exact = capacitance(relative_permittivity=1.0, area=AREA_M2, distance=distance, **VACUUM)
    columns = {
        "distance_m": distance,
        "capacitance_F": middle(exact),
        **band("capacitance", "F", uncertain),
    }
    return Figure(
        "fig7b",
        "Capacitance over plate distance",
        "C = ε0·A/d with A = 1 cm²; exact bounds for a distance that deviates by ±5 % (the paper "
        "names deviations and gives none). C falls ever more slowly and has no inflection point.",
        columns,
        "plate distance",
        (
            Panel(
                "capacitance",
                "F",
                lines={"C(d)": "capacitance_F"},
                bands={"d ± 5 %": ("capacitance_lo_F", "capacitance_hi_F")},
            ),
        ),
    )
