"""Beyond the paper's figures: how often noise feigns a touch or hides one."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from eskin.figures.figure import Figure, Panel, band, middle
from eskin.interval import Interval
from eskin.noise import error_rates

if TYPE_CHECKING:
    from eskin.figures.figure import Floats
    from eskin.noise import ErrorRates

TOUCHED_M2 = 1e-5
"""The smallest touch of Fig. 8."""
RESIDUE_M2 = 1e-6
"""What may seem to be touched when nothing is; the touched area is as uncertain."""
NOISES_M2 = (1e-6, 2e-6, 4e-6)
THRESHOLDS_M2 = (3e-6, 5e-6, 7e-6)
SHOWN_PERCENT: Final = (1e-4, 100.0)
"""From one error in a million upwards."""
KINDS: Final = ("false_positive", "false_negative")
CAPTION: Final = (
    "Probability of an error under Gaussian noise. Line: an area of 0 without and of 0.1 cm² with "
    "a touch. Band: every area up to 0.01 cm² without a touch, and of 0.09 to 0.11 cm² with one. "
    "All values are ours: the paper names false positives and false negatives and gives none. "
)


def draw_error_rates_threshold() -> Figure:
    """False positives and false negatives against the threshold, at three noises."""
    threshold = np.linspace(0.0, 12e-6, 241)
    rates = [_both(noise=noise, threshold=threshold) for noise in NOISES_M2]
    return _figure(
        "error_rates_threshold",
        "Wrong decisions against the threshold",
        "A higher threshold feigns fewer touches and hides more.",
        {"threshold_m2": threshold},
        rates,
        [f"σ = {noise * 1e4:.2f} cm²" for noise in NOISES_M2],
    )


def draw_error_rates_noise() -> Figure:
    """False positives and false negatives against the noise, at three thresholds."""
    noise = np.linspace(0.0, 8e-6, 241)
    rates = [_both(noise=noise, threshold=threshold) for threshold in THRESHOLDS_M2]
    return _figure(
        "error_rates_noise",
        "Wrong decisions against the noise",
        "More noise errs more in both ways; a threshold only trades one for the other.",
        {"noise_m2": noise},
        rates,
        [f"threshold {threshold * 1e4:.2f} cm²" for threshold in THRESHOLDS_M2],
    )


def _both(*, noise: Floats | float, threshold: Floats | float) -> tuple[ErrorRates, ErrorRates]:
    """The rates of the two exact areas, and those of all that are possible."""
    states = (
        (Interval(0.0), Interval(TOUCHED_M2)),
        (Interval(0.0, RESIDUE_M2), Interval.around(TOUCHED_M2, RESIDUE_M2)),
    )
    exact, possible = (
        error_rates(untouched=untouched, touched=touched, noise=noise, threshold=threshold)
        for untouched, touched in states
    )
    return exact, possible


def _figure(
    name: str,
    title: str,
    remark: str,
    columns: dict[str, Floats],
    rates: list[tuple[ErrorRates, ErrorRates]],
    labels: list[str],
) -> Figure:
    for number, (exact, possible) in enumerate(rates, start=1):
        for kind in KINDS:
            quantity = f"{kind}_{number}"
            columns[f"{quantity}_percent"] = middle(_percent(getattr(exact, kind)))
            columns |= band(quantity, "percent", _percent(getattr(possible, kind)))
    xlabel = next(iter(columns)).partition("_")[0]
    panels = tuple(_panel(kind, labels) for kind in KINDS)
    return Figure(name, title, CAPTION + remark, columns, xlabel, panels)


def _percent(rate: Interval) -> Interval:
    """One axis of per cent from a table with a single row or column."""
    return rate.ravel() * 100.0


def _panel(kind: str, labels: list[str]) -> Panel:
    numbers = dict(enumerate(labels, start=1))
    return Panel(
        f"{kind.replace('_', ' ')}s",
        "percent",
        lines={label: f"{kind}_{n}_percent" for n, label in numbers.items()},
        bands={
            f"{label}, interval": (f"{kind}_{n}_lo_percent", f"{kind}_{n}_hi_percent")
            for n, label in numbers.items()
        },
        logarithmic=SHOWN_PERCENT,
    )
