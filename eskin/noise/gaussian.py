"""Gaussian noise on touched area, capacitance and energy: drawn, or enclosed with its coverage."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from eskin.constants import VACUUM_PERMITTIVITY
from eskin.errors import IntervalError
from eskin.interval import Interval, as_interval, require_plain
from eskin.models.broadcasting import broadcast_shape
from eskin.models.parameters import (
    NOT_NEGATIVE,
    POSITIVE,
    not_negative,
    thin,
)
from eskin.models.touch import Touch, touch_of_area
from eskin.noise.normal import coverage_within
from eskin.union_bound import union_coverage

if TYPE_CHECKING:
    from numpy.random import Generator
    from numpy.typing import ArrayLike, NDArray

Floats: TypeAlias = "NDArray[np.float64]"


@dataclass(frozen=True, slots=True)
class GaussianNoise:
    """Standard deviations of what disturbs a touch.

    Noise on the area goes on into capacitance and energy; the other two add to what comes out.

    Attributes:
        area: Of the touched area in m².
        capacitance: Of the measured capacitance in F.
        energy: Of the energy in J.

    Raises:
        IntervalError: One is negative or not finite.
    """

    area: float = 0.0
    capacitance: float = 0.0
    energy: float = 0.0

    def __post_init__(self) -> None:
        for name in ("area", "capacitance", "energy"):
            value = getattr(self, name)
            if not (
                isinstance(value, (int, float, np.number)) and math.isfinite(value) and value >= 0.0
            ):
                raise IntervalError(
                    f"the standard deviation of {name} must be finite and >= 0, is {value!r}"
                )


@dataclass(frozen=True, slots=True)
class TouchReadings:
    """One noisy reading of each quantity at each instant.

    Attributes:
        area: In m², never negative.
        capacitance: In F.
        energy: In J.
    """

    area: Floats
    capacitance: Floats
    energy: Floats


def touch_with_noise(
    area: ArrayLike,
    *,
    distance: ArrayLike,
    voltage: ArrayLike,
    noise: GaussianNoise,
    generator: Generator,
    vacuum_permittivity: float = float(VACUUM_PERMITTIVITY.mid),
) -> TouchReadings:
    """Draw noisy readings of a touch, as in Fig. 8.

    Args:
        area: True touched area in m², any shape.
        distance: d in m, > 0.
        voltage: V in V, >= 0.
        noise: Standard deviations.
        generator: Draws the noise; the same seed gives the same readings.
        vacuum_permittivity: ε₀ in F/m.

    Returns:
        Area, ``C = ε₀ A/d`` and ``½ C V²`` of the noisy area, with the noise of their own.

    Raises:
        IntervalError: A number is not allowed, or shapes do not fit each other.
    """
    given = [
        thin("area", area, NOT_NEGATIVE),
        thin("distance", distance, POSITIVE),
        thin("voltage", voltage, NOT_NEGATIVE),
        thin("vacuum_permittivity", vacuum_permittivity, POSITIVE),
    ]
    for each in given:
        each.require_allowed()
    shape = broadcast_shape(given)
    true, apart, volts, permittivity = (each.inf for each in given)
    noisy = np.maximum(true + noise.area * generator.standard_normal(shape), 0.0)
    exact = permittivity * noisy / apart
    measured = exact + noise.capacitance * generator.standard_normal(shape)
    energy = 0.5 * measured * np.square(volts)
    return TouchReadings(noisy, measured, energy + noise.energy * generator.standard_normal(shape))


def touch_within(
    area: Interval | ArrayLike,
    *,
    distance: Interval | ArrayLike,
    voltage: Interval | ArrayLike,
    noise: GaussianNoise,
    deviations: float,
    vacuum_permittivity: Interval | ArrayLike = VACUUM_PERMITTIVITY,
) -> tuple[Touch, float]:
    """Enclose the readings whose noise stays within so many standard deviations.

    Args:
        area: True touched area in m², >= 0.
        distance: d in m, > 0.
        voltage: V in V, >= 0.
        noise: Standard deviations.
        deviations: How many of them, ``k``; infinity is not allowed, as no bound would be left.
        vacuum_permittivity: ε₀ in F/m.

    Returns:
        The enclosures, and the least share of readings that lie in all three of them. Each source
        of noise stays within ``k`` with `coverage_within`, and what several leave out adds up.

    Raises:
        IntervalError: A parameter is not allowed, or shapes do not fit each other.
    """
    require_plain(deviations, "deviations")
    if not math.isfinite(deviations):
        raise IntervalError(f"deviations must be finite and >= 0, is {deviations!r}")
    each = coverage_within(deviations)
    true = not_negative("area", area)
    true.require_allowed()
    disturbed = _around(true.interval, noise.area, deviations)
    disturbed = Interval(np.maximum(disturbed.inf, 0.0), disturbed.sup)
    exact = touch_of_area(
        disturbed, distance=distance, voltage=voltage, vacuum_permittivity=vacuum_permittivity
    )
    measured = _around(exact.capacitance, noise.capacitance, deviations)
    energy = exact.energy
    if noise.capacitance > 0.0:
        volts = as_interval(voltage)
        energy = measured * volts * volts * 0.5
    energy = _around(energy, noise.energy, deviations)
    sources = [each for sigma in (noise.area, noise.capacitance, noise.energy) if sigma > 0.0]
    return Touch(exact.area, measured, energy), union_coverage(*sources)


def _around(value: Interval, sigma: float, deviations: float) -> Interval:
    return value + Interval(-deviations, deviations) * sigma if sigma > 0.0 else value
