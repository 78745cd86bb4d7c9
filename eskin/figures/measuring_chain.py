"""Fig. 5a and 5b: from a swinging capacitance to a current."""

from __future__ import annotations

from typing import Final

import numpy as np

from eskin.figures.figure import Figure, Floats, Look, Panel, band, middle
from eskin.interval import Interval
from eskin.models import capacitive_chain

RESISTANCE_OHM = 1e3
TRANSCONDUCTANCE_S = 1e-3
SENSORS_F = ((10e-12, 100e-12), (20e-12, 150e-12), (5e-12, 50e-12))
TOLERANCE = 0.05
"""Relative tolerance of each sensor's least and greatest capacitance; the paper gives none."""

_SAME: Final = {
    "sensor 1": Look(width=2.6, alpha=0.5),
    "sensor 3": Look(style=(0.0, (5.0, 5.0)), width=1.6),
}
"""Sensors 1 and 3 have the same voltage and current: the first shows in the gaps of the last."""


def draw_fig5a() -> Figure:
    """Fig. 5a (eq. 5 and 6, V and I): C 10 to 100 pF at 2 Hz, R = 1 kΩ, G_m = 1 mA/V."""
    time = np.linspace(0.0, 1.0, 1001)
    least, most = SENSORS_F[0]
    chain = capacitive_chain(
        time,
        minimum_capacitance=least,
        maximum_capacitance=most,
        resistance=RESISTANCE_OHM,
        transconductance=TRANSCONDUCTANCE_S,
    )
    columns = {
        "time_s": time,
        "capacitance_F": middle(chain.capacitance),
        "frequency_Hz": middle(chain.frequency),
        "voltage_V": middle(chain.voltage),
        "current_A": middle(chain.current),
    }
    return Figure(
        "fig5a",
        "From capacitance to current",
        "Eq. 5 and 6, V = f/max f and I = Gm·V as the paper has them, at 1 kHz. With its "
        "Gm = 1 mA/V the current runs from 100 µA to 1 mA; the 100 nA that the text names need "
        "Gm = 1 µA/V.",
        columns,
        "time",
        (
            Panel("capacitance", "F", lines={"C(t)": "capacitance_F"}),
            Panel("frequency", "Hz", lines={"f(t)": "frequency_Hz"}),
            Panel("voltage", "V", lines={"V(t)": "voltage_V"}),
            Panel("current", "A", lines={"I(t)": "current_A"}),
        ),
    )


def draw_fig5b() -> Figure:
    """Fig. 5b: three sensors, with intervals."""
    time = np.linspace(0.0, 1.0, 1001)
    columns: dict[str, Floats] = {"time_s": time}
    for number, (least, most) in enumerate(SENSORS_F, start=1):
        fixed = {"resistance": RESISTANCE_OHM, "transconductance": TRANSCONDUCTANCE_S}
        nominal = capacitive_chain(
            time, minimum_capacitance=least, maximum_capacitance=most, **fixed
        )
        uncertain = capacitive_chain(
            time,
            minimum_capacitance=Interval.relative(least, TOLERANCE),
            maximum_capacitance=Interval.relative(most, TOLERANCE),
            **fixed,
        )
        columns |= {
            f"capacitance_{number}_F": middle(nominal.capacitance),
            **band(f"capacitance_{number}", "F", uncertain.capacitance),
            f"voltage_{number}_V": middle(nominal.voltage),
            **band(f"voltage_{number}", "V", uncertain.voltage),
            f"current_{number}_A": middle(nominal.current),
            **band(f"current_{number}", "A", uncertain.current),
        }
    return Figure(
        "fig5b",
        "Three sensors with intervals",
        "As Fig. 5a, for 10–100, 20–150 and 5–50 pF; exact bounds for least and greatest "
        "capacitances within ±5 % (the paper draws intervals and does not say how wide). "
        "Sensors 1 (pale) and 3 swing by the same ratio, so V and I are the same.",
        columns,
        "time",
        tuple(_panel(*kind) for kind in (("capacitance", "F"), ("voltage", "V"), ("current", "A"))),
    )


def _panel(quantity: str, unit: str) -> Panel:
    numbers = range(1, len(SENSORS_F) + 1)
    return Panel(
        quantity,
        unit,
        lines={f"sensor {n}": f"{quantity}_{n}_{unit}" for n in numbers},
        bands={
            f"sensor {n}, interval": (f"{quantity}_{n}_lo_{unit}", f"{quantity}_{n}_hi_{unit}")
            for n in numbers
        },
        looks={} if quantity == "capacitance" else _SAME,
    )
