"""Fig. 9: a metal object before an inductive sensor."""

from __future__ import annotations

import numpy as np

from eskin.figures.figure import Figure, Panel, middle
from eskin.interval import Interval
from eskin.models import oscillation, oscillation_paper, proximity

PARAMETERS = {
    "base_inductance": 10e-3,
    "inductance_change": 5e-3,
    "damping": 10.0,
    "capacitance": 1e-6,
    "mean_distance": 0.02,
    "distance_amplitude": 0.01,
}
VOLTAGE_V = 5.0
WINDOWS_S = ((0.0, 0.01), (0.5, 0.51))
"""What is drawn of the voltage: twice 20 of its 2000 periods."""


def draw_fig9() -> Figure:
    """Fig. 9 (eq. 11 to 13): distance, inductance, frequency and the oscillator's voltage."""
    time = np.linspace(0.0, 1.0, 50_001)
    sensed = proximity(time, **PARAMETERS)
    frequency = middle(sensed.frequency)
    steps = proximity(Interval(time[:-1], time[1:]), **PARAMETERS)
    voltage = oscillation(time, voltage=VOLTAGE_V, frequency=steps.frequency)
    columns = {
        "time_s": time,
        "distance_m": middle(sensed.distance),
        "inductance_H": middle(sensed.inductance),
        "frequency_Hz": frequency,
        "voltage_V": middle(oscillation_paper(time, voltage=VOLTAGE_V, frequency=frequency)),
        "voltage_corrected_V": middle(voltage),
    }
    return Figure(
        "fig9",
        "Inductive sensor",
        "Eq. 11 to 13 as the paper has them, over one period of the object. "
        "Voltage, paper: V0·sin(2π·f(t)·t). Corrected: the phase is the integral of f. Twice 10 ms "
        "are drawn: at first both agree; later the paper's runs at f + t·df/dt in place of f.",
        columns,
        "time",
        (
            Panel("distance", "m", lines={"d(t)": "distance_m"}),
            Panel("inductance", "H", lines={"L(t)": "inductance_H"}),
            Panel("frequency", "Hz", lines={"f_osc(t)": "frequency_Hz"}),
            *(
                Panel(
                    "voltage",
                    "V",
                    lines={
                        "V0·sin(2πft) (paper)": "voltage_V",
                        "phase integrated (corrected)": "voltage_corrected_V",
                    },
                    window=window,
                )
                for window in WINDOWS_S
            ),
        ),
    )
