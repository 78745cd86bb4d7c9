"""Plates that an actuator moves apart."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from pydantic import Field

from eskin.runtime.settings import Section
from eskin_sensor_node.kinds.settings import Positive, Tolerance

if TYPE_CHECKING:
    from eskin.interval import Floats
    from eskin_sensor_node.kinds.generator import ColumnGenerator


class Actuated(Section):
    """Plates that an actuator moves apart."""

    actuator_steps: int = Field(
        default=0, ge=0, le=100, description="steps by which the plates can be moved apart"
    )
    actuator_step_m: Positive = Field(default=2.5e-4, description="size of one, at rest")
    actuator_step_tolerance: Tolerance = Field(default=2e-3, description="of what a step adds")


def draw_actuator(taxel: Actuated, random: ColumnGenerator) -> Floats:
    """By how much each step of the actuator, from none on, takes plates at rest apart, in m.

    Returns:
        Shape ``(steps + 1, columns, 1)``.
    """
    levels = taxel.actuator_step_m * np.arange(taxel.actuator_steps + 1)[:, None, None]
    errors = taxel.actuator_step_tolerance * random.uniform(-1.0, 1.0, taxel.actuator_steps)
    return np.asarray(levels * np.concatenate([np.ones((1, len(random), 1)), 1.0 + errors]))
