"""True values, drawn from inside the intervals that a data sheet allows, a column each."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from eskin.constants import VACUUM_PERMITTIVITY

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from eskin.interval import Floats
    from eskin_sensor_node.kinds.generator import ColumnGenerator
    from eskin_sensor_node.kinds.noise import GaussianNoise, UniformNoise

_NATURE: Final = 2022
"""Seed of what is one and the same for all that is emulated."""
TRUE_VACUUM_PERMITTIVITY: Final = float(
    np.random.default_rng(_NATURE).uniform(VACUUM_PERMITTIVITY.inf, VACUUM_PERMITTIVITY.sup)
)
"""ε₀ in F/m: nature has one, somewhere inside what is known of it."""


def draw_part(random: ColumnGenerator, value: float, tolerance: float) -> Floats:
    """A true part of each column, uniformly from inside its tolerance."""
    return np.asarray(value * (1.0 + tolerance * random.uniform(-1.0, 1.0)))


def draw_noise(random: ColumnGenerator, noise: UniformNoise | GaussianNoise) -> Floats:
    """Noise of columns × instants."""
    if noise.kind == "uniform":
        drawn = random.uniform(-noise.bound, noise.bound)
        return np.clip(drawn, -noise.bound, noise.bound)
    return random.normal(0.0, noise.sigma)


def at_step(levels: Floats, steps: ArrayLike) -> Floats:
    """Of each column the level of its step, columns × 1; or of all the level of one step.

    Args:
        levels: Of each step, levels × columns × 1.
        steps: From 0 on, columns × 1, or one.
    """
    chosen = np.broadcast_to(np.asarray(steps, np.int64), levels.shape[1:])
    return np.asarray(np.take_along_axis(levels, chosen[None], axis=0)[0])
