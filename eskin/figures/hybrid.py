"""Fig. 10a and 10b: the hybrid sensor (ICM) after switching on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from eskin.figures.figure import Figure, Panel, band, middle
from eskin.interval import Interval
from eskin.models.icm import IcmParameters

TOLERANCE = 0.05
CAPTION = (
    "Eq. 26 and 27 with Vm = 5 V, 50 Hz, C = 1 µF, L = 1 mH. R1 = 10 kΩ, R2 = 2419 Ω and "
    "ψ = −46° are ours: the paper gives none, and its sentences cannot all hold. Band: parts "
    "within ±5 %."
)


SETTLED_S = 1e-6
SETTLED = " Inset: from zero the current settles within 1 µs (L/R1 = 0.1 µs)."


def draw_fig10a() -> Figure:
    """Fig. 10a (eq. 27): the voltage of the EcFES beside the source."""
    time, nominal, uncertain = _sensors()
    columns = {
        "time_s": time,
        "voltage_V": middle(nominal.ecfes_voltage(time)),
        **band("voltage", "V", uncertain.ecfes_voltage(time)),
        "input_voltage_V": middle(nominal.source_voltage(time)),
    }
    panels = (
        Panel("input voltage", "V", lines={"V(t)": "input_voltage_V"}),
        Panel(
            "EcFES voltage",
            "V",
            lines={"u_c(t)": "voltage_V"},
            bands={"parts ± 5 %": ("voltage_lo_V", "voltage_hi_V")},
        ),
    )
    return Figure("fig10a", "Hybrid sensor: EcFES voltage", CAPTION, columns, "time", panels)


def draw_fig10b() -> Figure:
    """Fig. 10b (eq. 26): the current of the MagFES beside the source."""
    time, nominal, uncertain = _sensors()
    columns = {
        "time_s": time,
        "current_A": middle(nominal.magfes_current(time)),
        **band("current", "A", uncertain.magfes_current(time)),
        "input_voltage_V": middle(nominal.source_voltage(time)),
    }
    panels = (
        Panel("input voltage", "V", lines={"V(t)": "input_voltage_V"}),
        Panel(
            "MagFES current",
            "A",
            lines={"i1(t)": "current_A"},
            bands={"parts ± 5 %": ("current_lo_A", "current_hi_A")},
            inset=(0.0, SETTLED_S),
        ),
    )
    return Figure(
        "fig10b", "Hybrid sensor: MagFES current", CAPTION + SETTLED, columns, "time", panels
    )


def _sensors() -> tuple[np.ndarray[tuple[int], np.dtype[np.float64]], IcmParameters, IcmParameters]:
    nominal = IcmParameters()
    parts = ("coil_resistance", "inductance", "capacitor_resistance", "capacitance")
    loose = {part: Interval.relative(getattr(nominal, part), TOLERANCE) for part in parts}
    time = np.concatenate([np.linspace(0.0, SETTLED_S, 101), 1e-6 * np.arange(2.0, 1001.0)])
    return time, nominal, replace(nominal, **loose)
