"""The models as plain expressions, for whatever runs through an expression.

`eskin.design.Dual` does, which differentiates it, and so does a plain `eskin.Interval`: but then
every parameter that occurs twice widens the result, which is why the models themselves are not
written like this. All arguments are in SI units, named as in the models.
"""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np

from eskin.constants import TWO_PI, VACUUM_PERMITTIVITY

Quantity: TypeAlias = Any
"""Whatever calculates: a `eskin.design.Dual`, an `eskin.Interval`."""


def capacitance(*, relative_permittivity: Quantity, area: Quantity, distance: Quantity) -> Quantity:
    """``ε₀ εᵣ A / d`` (eq. 2), in F."""
    return VACUUM_PERMITTIVITY * relative_permittivity * area / distance


def rc_frequency(*, resistance: Quantity, capacitance: Quantity) -> Quantity:
    """``1 / (2π R C)`` (eq. 6), in Hz."""
    return 1.0 / (TWO_PI * resistance * capacitance)


def lc_frequency(*, inductance: Quantity, capacitance: Quantity) -> Quantity:
    """``1 / (2π √(L C))`` (eq. 3, 12), in Hz."""
    return 1.0 / (TWO_PI * np.sqrt(inductance * capacitance))


def proximity_inductance(
    *, base_inductance: Quantity, inductance_change: Quantity, damping: Quantity, distance: Quantity
) -> Quantity:
    """``L₀ - ΔL·e^(-α d)`` (eq. 11), in H."""
    return base_inductance - inductance_change * np.exp(-damping * distance)


def proximity_frequency(
    *,
    base_inductance: Quantity,
    inductance_change: Quantity,
    damping: Quantity,
    distance: Quantity,
    capacitance: Quantity,
) -> Quantity:
    """The frequency of an LC oscillator whose coil feels a distance (eq. 11 and 12), in Hz."""
    inductance = proximity_inductance(
        base_inductance=base_inductance,
        inductance_change=inductance_change,
        damping=damping,
        distance=distance,
    )
    return lc_frequency(inductance=inductance, capacitance=capacitance)


def coil_current(
    *, voltage: Quantity, resistance: Quantity, inductance: Quantity, frequency: Quantity
) -> Quantity:
    """``V / |R + jωL|`` (eq. 1), in A."""
    reactance = TWO_PI * frequency * inductance
    return voltage / np.sqrt(resistance * resistance + reactance * reactance)


def coil_energy(
    *, inductance: Quantity, voltage: Quantity, resistance: Quantity, time: Quantity
) -> Quantity:
    """``½ L (V/Z)² e^(-2Zt/L)`` (eq. 30 solved), in J."""
    current = voltage / resistance
    decay = np.exp(-2.0 * resistance * time / inductance)
    return 0.5 * inductance * current * current * decay


def icm_response(
    *, time_constant: Quantity, angular_frequency: Quantity, time: Quantity, phase: Quantity
) -> Quantity:
    """``h(t; τ)`` of the hybrid sensor (eq. 26 and 27): 1 for the amplitude of the source."""
    x = angular_frequency * time_constant
    angle = angular_frequency * time + phase
    start = np.sin(phase) - x * np.cos(phase)
    decay = np.exp(-time / time_constant)
    return (np.sin(angle) - x * np.cos(angle) - start * decay) / (1.0 + x * x)
