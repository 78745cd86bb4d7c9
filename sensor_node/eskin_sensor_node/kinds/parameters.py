"""True values, drawn from inside the intervals that a data sheet allows."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from eskin.constants import VACUUM_PERMITTIVITY

if TYPE_CHECKING:
    from eskin.interval import Floats
    from eskin_sensor_node.kinds.noise import GaussianNoise, UniformNoise

_NATURE: Final = 2022
"""Seed of what is one and the same for all that is emulated."""
TRUE_VACUUM_PERMITTIVITY: Final = float(
    np.random.default_rng(_NATURE).uniform(VACUUM_PERMITTIVITY.inf, VACUUM_PERMITTIVITY.sup)
)
"""ε₀ in F/m: nature has one, somewhere inside what is known of it."""


def draw_part(random: np.random.Generator, value: float, tolerance: float) -> float:
    """A true part, uniformly from inside its tolerance; a generator of columns gives a column."""
    return value * (1.0 + tolerance * random.uniform(-1.0, 1.0))


def draw_noise(
    random: np.random.Generator, noise: UniformNoise | GaussianNoise, shape: tuple[int, ...]
) -> Floats:
    """Noise for samples of a shape."""
    if noise.kind == "uniform":
        drawn = random.uniform(-noise.bound, noise.bound, shape)
        return np.clip(drawn, -noise.bound, noise.bound)
    return random.normal(0.0, noise.sigma, shape)
