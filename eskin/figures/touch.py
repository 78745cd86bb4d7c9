"""Fig. 8: a touch changes the area of the plates, with Gaussian noise."""

from __future__ import annotations

import numpy as np

from eskin.constants import PAPER_VACUUM_PERMITTIVITY
from eskin.figures.figure import Figure, Look, Panel, band, middle
from eskin.models import touch
from eskin.noise import GaussianNoise, touch_with_noise, touch_within

LEAST_M2 = 1e-5
MOST_M2 = 1e-4
DISTANCE_M = 1e-3
VOLTAGE_V = 0.5
"""As in the paper's sum of 0.125 µW; its Fig. 8 names no voltage."""
NOISE_M2 = 2e-6
"""Standard deviation of the area; the paper gives none."""
DEVIATIONS = 6.0
SEED = 8


def draw_fig8() -> Figure:
    """Fig. 8 (eq. 10): area, capacitance and energy, without and with noise."""
    time = np.linspace(0.0, 2.5, 2501)
    plate = {
        "distance": DISTANCE_M,
        "voltage": VOLTAGE_V,
        "vacuum_permittivity": PAPER_VACUUM_PERMITTIVITY,
    }
    ideal = touch(time, minimum_area=LEAST_M2, maximum_area=MOST_M2, **plate)
    noise = GaussianNoise(area=NOISE_M2)
    area = middle(ideal.area)
    noisy = touch_with_noise(area, **plate, noise=noise, generator=np.random.default_rng(SEED))
    within, _ = touch_within(ideal.area, **plate, noise=noise, deviations=DEVIATIONS)
    columns = {
        "time_s": time,
        "area_m2": area,
        "area_noisy_m2": noisy.area,
        **band("area", "m2", within.area),
        "capacitance_F": middle(ideal.capacitance),
        "capacitance_noisy_F": noisy.capacitance,
        **band("capacitance", "F", within.capacitance),
        "energy_J": middle(ideal.energy),
        "energy_noisy_J": noisy.energy,
        **band("energy", "J", within.energy),
    }
    return Figure(
        "fig8",
        "Touch with Gaussian noise",
        "Eq. 10 as the paper has it: A from 0.1 to 1 cm² at 0.8 Hz, d = 1 mm. Noise of 0.02 cm² "
        "(σ) on the area and V = 0.5 V are ours; the band holds a reading "
        "with a probability of 1 − 2·10⁻⁹ (6σ), areas below zero cut off.",
        columns,
        "time",
        tuple(_panel(*kind) for kind in (("area", "m2"), ("capacitance", "F"), ("energy", "J"))),
    )


def _panel(quantity: str, unit: str) -> Panel:
    return Panel(
        quantity,
        unit,
        lines={"with noise": f"{quantity}_noisy_{unit}", "ideal": f"{quantity}_{unit}"},
        looks={"with noise": Look(style="--", width=0.7), "ideal": Look(style="-", width=1.5)},
        bands={"6σ": (f"{quantity}_lo_{unit}", f"{quantity}_hi_{unit}")},
    )
