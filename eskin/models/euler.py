"""The coil's energy step by step (eq. 31), as the paper has it: bounds that enclose nothing."""

from __future__ import annotations

import enum
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from eskin.errors import IntervalError
from eskin.interval import require_plain
from eskin.models.broadcasting import broadcast_shape
from eskin.models.parameters import not_negative, positive

if TYPE_CHECKING:
    from eskin.models.parameters import Bounds, Floats, Parameter


class EulerRule(enum.Enum):
    """How a step of eq. 31 is taken with interval parameters; the paper does not say."""

    INTERVAL = "interval"
    """In interval arithmetic. E occurs twice in a step, so the bounds run apart."""
    CORNER = "corner"
    """Each bound by itself, with the parameters that drain it fastest or slowest."""


@dataclass(frozen=True, slots=True)
class EulerEnergy:
    """Two curves, on purpose not an `eskin.Interval`: they do not enclose the solution.

    Attributes:
        time: Instants in s.
        lower: The curve that the paper calls E_min, in J; the last axis is time.
        upper: The curve that the paper calls E_max, in J.
    """

    time: Floats
    lower: Floats
    upper: Floats


def _begin(v: Parameter, z: Parameter, inductor: Parameter, steps: int) -> tuple[Floats, Floats]:
    """Curves of which the first instant is known: ``½ L (V/Z)²``."""
    lower, upper = (np.zeros((*broadcast_shape([v, z, inductor]), steps + 1)) for _ in "lu")
    lower[..., 0] = 0.5 * inductor.inf * (v.inf / z.sup) ** 2
    upper[..., 0] = 0.5 * inductor.sup * (v.sup / z.inf) ** 2
    return lower, upper


def _power(energy: Floats, z: Parameter, inductor: Parameter) -> tuple[Floats, Floats]:
    """``2 E Z / L`` in interval arithmetic for one bound of E."""
    corners = [2.0 * energy * r / x for r in (z.inf, z.sup) for x in (inductor.inf, inductor.sup)]
    return np.minimum.reduce(corners), np.maximum.reduce(corners)


def coil_energy_euler_paper(
    *,
    voltage: Bounds,
    loss_resistance: Bounds,
    inductance: Bounds,
    step: float,
    steps: int,
    rule: EulerRule = EulerRule.INTERVAL,
) -> EulerEnergy:
    """Eq. 31, ``E(t + Δt) = E(t) - Δt·I² Z`` with ``I² = 2E/L``, as the paper has it.

    Not an enclosure, and no substitute for `eskin.models.coil_energy.coil_energy`. With the
    paper's values the interval rule is 50 times too wide after 2 ms, and its lower curve is
    negative from 0.1 ms on. The corner rule stays below the solution, its upper curve too.

    Args:
        voltage: V in V, >= 0.
        loss_resistance: The paper's Z_L in Ω, > 0.
        inductance: L in H, > 0.
        step: Δt in s, > 0.
        steps: How many, >= 0.
        rule: How a step is taken.

    Returns:
        The curves at ``0, Δt, …, steps·Δt``; time is their last axis, before it those of the
        parameters.

    Raises:
        IntervalError: A parameter is not allowed, or shapes do not fit each other.
        ValueError: The rule is none.
    """
    v, z = not_negative("voltage", voltage), positive("loss_resistance", loss_resistance)
    inductor = positive("inductance", inductance)
    for each in (v, z, inductor):
        each.require_allowed()
    require_plain(step, "step")
    if not (step > 0.0 and np.isfinite(step) and steps >= 0):
        raise IntervalError(f"step must be > 0 and steps >= 0, are {step!r} and {steps!r}")
    lower, upper = _begin(v, z, inductor, steps)
    for k in range(steps):
        low, high = lower[..., k], upper[..., k]
        if EulerRule(rule) is EulerRule.CORNER:
            lower[..., k + 1] = low - step * z.sup * (2.0 * low / inductor.inf)
            upper[..., k + 1] = high - step * z.inf * (2.0 * high / inductor.sup)
            continue
        lower[..., k + 1] = low - step * _power(high, z, inductor)[1]
        upper[..., k + 1] = high - step * _power(low, z, inductor)[0]
    times: Floats = step * np.arange(steps + 1, dtype=np.float64)
    return EulerEnergy(times, lower, upper)
