"""Fig. 6: a swinging capacitance at an alternating voltage."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from eskin.figures.figure import Figure, Panel, middle
from eskin.models import (
    Swing,
    alternating_capacitance_paper,
    alternating_current,
    alternating_current_paper,
)
from eskin.models.icm import source_voltage

SWING: Final[dict[str, Any]] = {"minimum_capacitance": 10e-12, "maximum_capacitance": 100e-12}
VOLTAGE_V = 5.0
FREQUENCY_HZ = 50.0


def draw_fig6() -> Figure:
    """Fig. 6 (eq. 7 and 8) over the first eighth of a second, where eq. 7 is positive."""
    time = np.linspace(0.0, 0.125, 2501)
    source: dict[str, Any] = {"voltage": VOLTAGE_V, "voltage_frequency": FREQUENCY_HZ}
    paper = alternating_current_paper(time, **SWING, **source)
    whole = alternating_current(time, **SWING, **source, swing=Swing.PAPER)
    columns = {
        "time_s": time,
        "voltage_V": middle(
            source_voltage(time, amplitude=VOLTAGE_V, frequency=FREQUENCY_HZ, phase=0.0)
        ),
        "capacitance_F": middle(alternating_capacitance_paper(time, **SWING)),
        "current_A": middle(paper),
        "current_corrected_A": middle(whole),
        "difference_A": middle(whole - paper),
    }
    return Figure(
        "fig6",
        "Response of the capacitive sensor to V(t)",
        "Paper: I = C·dV/dt (eq. 8), C of eq. 7, V = 5 V at 50 Hz. Corrected: I = d(CV)/dt, which "
        "the swing of C adds to. Shown to 0.125 s: then eq. 7 falls, below zero from 0.259 s on.",
        columns,
        "time",
        (
            Panel("voltage", "V", lines={"V(t)": "voltage_V"}),
            Panel("capacitance", "F", lines={"C(t), eq. 7": "capacitance_F"}),
            Panel(
                "current",
                "A",
                lines={
                    "C·dV/dt (paper)": "current_A",
                    "d(CV)/dt (corrected)": "current_corrected_A",
                },
            ),
            Panel("difference", "A", lines={"V·dC/dt, left out by eq. 8": "difference_A"}),
        ),
    )
