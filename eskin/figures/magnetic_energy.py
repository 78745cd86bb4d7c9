"""Fig. 4a: the energy of the MagFES coil decays."""

from __future__ import annotations

import numpy as np

from eskin.figures.figure import Figure, Panel, band, middle
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
        "energy_lo_J": paper.lower,
        "energy_hi_J": paper.upper,
        **band("energy_corrected", "J", exact),
    }
    return Figure(
        "fig4a",
        "Energy of the magnetic sensor",
        "Paper: E_min and E_max step by step (eq. 31, 10 µs), each with its worst parameters. "
        "Corrected: the exact range of eq. 30's solution, which eq. 31's upper curve falls below. "
        "Line: L = 10 mH, Z = 5 Ω, V = 1 V. The paper gives no length of time: 5 ms.",
        columns,
        "time",
        (
            Panel(
                "energy",
                "J",
                lines={
                    "eq. 31, E_min (paper)": "energy_lo_J",
                    "eq. 31, E_max (paper)": "energy_hi_J",
                    "nominal": "energy_J",
                },
                bands={"exact range": ("energy_corrected_lo_J", "energy_corrected_hi_J")},
            ),
        ),
    )
