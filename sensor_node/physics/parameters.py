"""True values, drawn from inside the intervals that a data sheet allows."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from eskin.interval import Interval

if TYPE_CHECKING:
    from eskin.interval import Floats
    from sensor_node.noise import GaussianNoise, UniformNoise


def draw(random: np.random.Generator, interval: Interval) -> float:
    """A true value, uniformly from inside a scalar interval."""
    lo, hi = float(interval.inf), float(interval.sup)
    return min(max(float(random.uniform(lo, hi)), lo), hi)


def draw_part(random: np.random.Generator, value: float, tolerance: float) -> float:
    """A true part, uniformly from inside its tolerance."""
    return draw(random, Interval.relative(value, tolerance))


def draw_noise(random: np.random.Generator, noise: UniformNoise | GaussianNoise, n: int) -> Floats:
    """Noise for n samples."""
    if noise.kind == "uniform":
        drawn = random.uniform(-noise.bound, noise.bound, n)
        return np.clip(drawn, -noise.bound, noise.bound)
    return random.normal(0.0, noise.sigma, n)
