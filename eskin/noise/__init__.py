"""Gaussian noise on a touch, and what a threshold makes of it (Fig. 8)."""

from __future__ import annotations

from eskin.noise.detection import detect
from eskin.noise.error_rates import ErrorRates, error_rates
from eskin.noise.gaussian import GaussianNoise, TouchReadings, touch_with_noise, touch_within
from eskin.noise.normal import coverage_within, upper_tail

__all__ = [
    "ErrorRates",
    "GaussianNoise",
    "TouchReadings",
    "coverage_within",
    "detect",
    "error_rates",
    "touch_with_noise",
    "touch_within",
    "upper_tail",
]
