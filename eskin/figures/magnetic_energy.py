"""Fig. 4a: the energy of the MagFES coil decays."""

from __future__ import annotations

import numpy as np

from eskin.figures.figure import Figure, Look, Panel, band, middle
from eskin.interval import Interval
from eskin.models import EulerRule, coil_energy, coil_energy_euler_paper

STEP_S = 1e-5
STEPS = 500


def draw_fig4a() -> Figure:
    """Fig. 4a (eq. 30 and 31): L 9 to 11 mH, Z_L 4 to 6 Ω, V 0.9 to 1.1 V."""
    box = {
        "voltage": Interval(0.9, 1.1),
        "loss_resistance": Interval(4.0, 6.0),
        "inductance": Interval(9e-3, 11e-3),
    }
    nominal = {"voltage": 1.0, "loss_resistance": 5.0, "inductance": 10e-3}
    paper = coil_energy_euler_paper(**box, step=STEP_S, steps=STEPS, rule=EulerRule.CORNER)
    time = np.asarray(paper.time)
    exact = coil_energy(time, **box)
    columns = {
        "time_s": time,
        "energy_J": middle(coil_energy(time, **nominal)),
        **band("energy", "J", exact),
        "energy_min_euler_J": paper.lower,
        "energy_max_euler_J": paper.upper,
        "error_min_percent": 100.0 * (paper.lower / exact.inf - 1.0),
        "error_max_percent": 100.0 * (paper.upper / exact.sup - 1.0),
    }
    return Figure(
        "fig4a",
        "Energy of the magnetic sensor",
        "Band: exact range of eq. 30's solution. Paper: E_min and E_max step by step (eq. 31), "
        "each with its worst parameters, and its relative error: no enclosure, as E_max runs below "
        "the true maximum. "
        "Line: L = 10 mH, Z = 5 Ω, V = 1 V. Step (10 µs) and length (5 ms) are ours.",
        columns,
        "time",
        (
            Panel(
                "energy",
                "J",
                lines={
                    "nominal": "energy_J",
                    "eq. 31, E_min (paper)": "energy_min_euler_J",
                    "eq. 31, E_max (paper)": "energy_max_euler_J",
                },
                bands={"exact range": ("energy_lo_J", "energy_hi_J")},
            ),
            Panel(
                "relative error",
                "percent",
                lines={
                    "E_min over the true minimum": "error_min_percent",
                    "E_max over the true maximum": "error_max_percent",
                },
                looks={
                    "E_min over the true minimum": Look(1, "--"),
                    "E_max over the true maximum": Look(2, ":"),
                },
            ),
        ),
    )
